"""The paper's Fig. 4: reference and actual position of a staircase, a without and b with compensation, with the error below."""

from __future__ import annotations

import altair as alt
import numpy as np
import pandas as pd

from bench.experiment.plots import (
    DASHED,
    HINDSIGHT,
    LEARNED,
    REFERENCE,
    STRAIGHT,
    Exhibit,
    Line,
    above,
    axis,
    beside,
    plot,
)
from bench.rig.rig import AXES, RANGE_UM, percent
from bench.rig.trial import Trial

THINNING = 8
"""One sample in so many is drawn and stored: 1 kHz."""


def exhibit(i: int, straight: Trial, hindsight: Trial, learned: Trial) -> Exhibit:
    """Draw one period of the staircase in the last cycle of one axis."""
    rig, name = learned.rig, AXES[i]
    end = len(rig.y_ref)
    window = np.arange(max(0, end - rig.period), end, THINNING)
    t = (window - window[0]) * rig.sample_time
    reference = rig.y_ref[window, i]
    runs = {"straight": straight, "hindsight": hindsight, "learned": learned}
    table = pd.DataFrame({"time_s": t, "reference_um": reference,
                          **{f"{key}_um": run.y[window, i] for key, run in runs.items()}})

    across = axis("time, s", domain=[0.0, float(t[-1])])
    places = axis(f"position {name}, µm", domain=[1.2 * float(reference.min()), 1.2 * float(reference.max())])
    zero = Line("zero", t[[0, -1]], np.zeros(2), REFERENCE, width=0.6)

    def position(run: Trial, colour: str, title: str) -> alt.TopLevelMixin:
        return plot([Line("actual", t, run.y[window, i], colour), Line("reference", t, reference, REFERENCE, DASHED, width=1.0)],
                    across, places, 340, 200, title)

    def error(run: Trial, label: str, colour: str, unit: float = 1.0) -> Line:
        return Line(label, t, unit * run.error_um[window, i], colour, width=0.9)

    chart = above(
        beside(position(straight, STRAIGHT, "a) without compensation"), position(learned, LEARNED, "b) with self-learning compensation")),
        beside(plot([error(hindsight, "best straight line with hindsight", HINDSIGHT), error(straight, "straight line", STRAIGHT)],
                    across, axis("error, µm"), 340, 130),
               plot([zero, error(learned, "self-learning", LEARNED, 1e3)], across, axis("error, nm"), 340, 130, legend=False)))

    before, best, after = (float(run.rms_percent()[i]) for run in (straight, hindsight, learned))
    worst = [float(np.abs(percent(run.cycle_error_um(-1)))[:, i].max()) for run in (straight, hindsight, learned)]
    sentence = (f"Axis {name}, last cycle: RMS error {before:.2f} % of range ({before / 100 * RANGE_UM:.2f} µm) along a straight "
                f"line, {best:.2f} % along the best straight line with hindsight, {after:.3f} % "
                f"({after / 100 * RANGE_UM * 1e3:.0f} nm) with self-learning compensation, {before / after:.0f} times less; "
                f"largest error {worst[0]:.1f} %, {worst[1]:.1f} % and {worst[2]:.2f} %.")
    return Exhibit(f"fig4_staircase_{name}", f"Fig. 4: staircase, axis {name}",
                   "One period of the staircase in the last cycle. Both runs stand behind the same decoupling matrix.",
                   (sentence,), table, chart)
