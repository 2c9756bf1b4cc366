"""The paper's Fig. 4: reference and actual position of a staircase, a without and b with compensation, with the error below."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bench.experiment.style import HINDSIGHT, LEARNED, REFERENCE, STRAIGHT, Exhibit, legend_above
from bench.rig.rig import AXES, RANGE_UM, percent
from bench.rig.trial import Trial

THINNING = 8
"""One sample in so many is drawn and stored: 1 kHz."""


def exhibit(axis: int, straight: Trial, hindsight: Trial, learned: Trial) -> Exhibit:
    """Draw one period of the staircase in the last cycle of one axis."""
    rig, name = learned.rig, AXES[axis]
    end = len(rig.y_ref)
    window = np.arange(max(0, end - rig.period), end, THINNING)
    t = (window - window[0]) * rig.sample_time
    reference = rig.y_ref[window, axis]
    runs = {"straight": straight, "hindsight": hindsight, "learned": learned}
    table = pd.DataFrame({"time_s": t, "reference_um": reference,
                          **{f"{key}_um": run.y[window, axis] for key, run in runs.items()}})

    def draw(figure: Figure) -> None:
        (a, b), (a_error, b_error) = figure.subplots(2, 2, sharex=True, height_ratios=(3, 2))
        for axes, run, colour, title in ((a, straight, STRAIGHT, "a) without compensation"),
                                         (b, learned, LEARNED, "b) with self-learning compensation")):
            axes.plot(t, reference, color=REFERENCE, lw=1.0, ls="--", label=f"reference $s_{{r{name}}}$", zorder=3)
            axes.plot(t, run.y[window, axis], color=colour, label=f"actual $s_{name}$")
            axes.set_title(title)
            axes.set_ylim(1.2 * reference.min(), 1.5 * reference.max())  # room for the legend
            axes.legend(loc="upper right", ncols=2)
        a.set_ylabel(f"position {name}, µm")
        a_error.set_ylabel("error, µm")
        b_error.set_ylabel("error, nm")
        a_error.plot(t, hindsight.error_um[window, axis], color=HINDSIGHT, lw=0.9, label="best straight line with hindsight")
        a_error.plot(t, straight.error_um[window, axis], color=STRAIGHT, label="straight line")
        legend_above(a_error, 2)
        b_error.plot(t, 1e3 * learned.error_um[window, axis], color=LEARNED, lw=0.9)
        for axes in (a_error, b_error):
            axes.axhline(0.0, color=REFERENCE, lw=0.6)
            axes.set_xlabel("time, s")
            axes.set_xlim(0.0, t[-1])

    before, best, after = (float(run.rms_percent()[axis]) for run in (straight, hindsight, learned))
    worst = [float(np.abs(percent(run.cycle_error_um(-1)))[:, axis].max()) for run in (straight, hindsight, learned)]
    sentence = (f"Axis {name}, last cycle: RMS error {before:.2f} % of range ({before / 100 * RANGE_UM:.2f} µm) along a straight "
                f"line, {best:.2f} % along the best straight line with hindsight, {after:.3f} % "
                f"({after / 100 * RANGE_UM * 1e3:.0f} nm) with self-learning compensation, {before / after:.0f} times less; "
                f"largest error {worst[0]:.1f} %, {worst[1]:.1f} % and {worst[2]:.2f} %.")
    return Exhibit(f"fig4_staircase_{name}", f"Fig. 4: staircase, axis {name}",
                   "One period of the staircase in the last cycle. Both runs stand behind the same decoupling matrix.",
                   (sentence,), table, draw, 5.2)
