"""Hysteresis loops before and after: the measured position over the reference, for triangles of falling amplitude."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from bench.experiment.runs import LEARNED, STRAIGHT, THINNING, lines
from bench.report.plot import Axis
from bench.report.report import Figure
from bench.stage.setup import AMPLITUDE_UM, AXES, RANGE_UM, StageSetup
from bench.stage.trial import Trial
from solvers.arrays import Vector

BINS = 64


def arrived(setup: StageSetup) -> int:
    """Sample from which on a loop counts: before it the stage comes from the staircase."""
    return round(setup.step_s / setup.sample_time)


def opening_percent(reference: Vector, y: Vector) -> float:
    """Widest opening of the loops in percent of the range: the largest spread of y over references that are nearly the
    same."""
    share = (reference + AMPLITUDE_UM) / RANGE_UM
    bins = np.clip((share * BINS).astype(int), 0, BINS - 1)
    error = y - reference
    return 100.0 / RANGE_UM * max(float(np.ptp(error[bins == i])) for i in range(BINS) if np.any(bins == i))


def figure(runs: Mapping[str, Trial]) -> Figure:
    """The loops of both axes, and what is left of them on a finer scale."""
    setup = runs[LEARNED].setup
    at = np.arange(arrived(setup), len(setup.loop_ref), THINNING)
    table = pd.concat(
        [
            pd.DataFrame(
                {
                    "axis": axis,
                    "name": name,
                    "sample": at,
                    "reference_um": (reference := setup.loop_ref[at, i]),
                    "position_um": (y := runs[name].loop[at, i]),
                    "error_um": y - reference,
                }
            )
            for i, axis in enumerate(AXES)
            for name in (STRAIGHT, LEARNED)
        ],
        ignore_index=True,
    )
    plots = []
    for axis in AXES:
        x, where = Axis("reference_um", f"reference {axis}, µm"), f"axis == '{axis}'"
        plots += [
            lines(x, Axis("position_um", "measured position, µm"), (STRAIGHT, LEARNED), where, "sample"),
            lines(x, Axis("error_um", "error, µm"), (LEARNED,), where, "sample", height=150),
        ]
    return Figure(
        "loops",
        "Hysteresis loops before and after",
        "Measured position over reference for triangles of "
        "falling amplitude, on signals that were never learned from; below each, what compensation leaves.",
        table,
        plots,
    )


def sentences(runs: Mapping[str, Trial]) -> Iterator[str]:
    """How far the loops open."""
    setup = runs[LEARNED].setup
    part = slice(arrived(setup), None)
    for i, axis in enumerate(AXES):
        wide, narrow = (
            opening_percent(setup.loop_ref[part, i], runs[name].loop[part, i]) for name in (STRAIGHT, LEARNED)
        )
        yield (
            f"Axis {axis}: the loops open by {wide:.1f} % of range along a straight line and by {narrow:.2f} % with "
            "compensation, on a signal that was never learned from."
        )
