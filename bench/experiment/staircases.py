"""The paper's Fig. 4: reference and actual position of a staircase without and with compensation, and the errors
below."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from bench.experiment.runs import HINDSIGHT, LEARNED, REFERENCE, STRAIGHT, THINNING, lines
from bench.report.plot import Axis
from bench.report.report import Figure
from bench.stage.setup import AXES, RANGE_UM, percent
from bench.stage.trial import Trial


def figure(i: int, runs: Mapping[str, Trial]) -> Figure:
    """One period of the staircase in the last cycle of one axis."""
    setup = runs[LEARNED].setup
    end = len(setup.y_ref)
    window = np.arange(max(0, end - setup.period), end, THINNING)
    t, reference = (window - window[0]) * setup.sample_time, setup.y_ref[window, i]
    positions = {REFERENCE: reference, **{name: run.y[window, i] for name, run in runs.items()}}
    table = pd.concat(
        [
            pd.DataFrame({"time_s": t, "name": name, "position_um": y, "error_um": y - reference})
            for name, y in positions.items()
        ],
        ignore_index=True,
    )
    time, error = Axis("time_s", "time, s"), Axis("error_um", "error, µm")
    plots = [
        lines(time, Axis("position_um", f"position {AXES[i]}, µm"), (STRAIGHT, LEARNED, REFERENCE)),
        lines(time, error, (STRAIGHT, HINDSIGHT), height=150),
        lines(time, error, (LEARNED,), height=150),
    ]
    return Figure(
        f"fig4_staircase_{AXES[i]}",
        f"Fig. 4: staircase, axis {AXES[i]}",
        "One period of the staircase in the last cycle. All runs stand behind the same decoupling matrix.",
        table,
        plots,
    )


def sentence(i: int, runs: Mapping[str, Trial]) -> str:
    """The errors of one axis in the last cycle."""
    before, best, after = (float(runs[name].rms_percent()[i]) for name in (STRAIGHT, HINDSIGHT, LEARNED))
    worst = [
        float(np.abs(percent(runs[name].cycle_error_um(-1)))[:, i].max()) for name in (STRAIGHT, HINDSIGHT, LEARNED)
    ]
    return (
        f"Axis {AXES[i]}, last cycle: RMS error {before:.2f} % of range ({before / 100 * RANGE_UM:.2f} µm) along a "
        f"straight line, {best:.2f} % along the best straight line with hindsight, {after:.3f} % "
        f"({after / 100 * RANGE_UM * 1e3:.0f} nm) with self-learning compensation, {before / after:.0f} times less; "
        f"largest error {worst[0]:.1f} %, {worst[1]:.1f} % and {worst[2]:.2f} %."
    )
