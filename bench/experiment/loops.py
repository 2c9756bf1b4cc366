"""Hysteresis loops before and after: the measured position over the reference, for triangles of falling amplitude."""

from __future__ import annotations

import altair as alt
import numpy as np
import pandas as pd

from bench.experiment.plots import LEARNED, REFERENCE, STRAIGHT, Exhibit, Line, above, axis, beside, plot
from bench.rig.rig import AMPLITUDE_UM, AXES, RANGE_UM
from bench.rig.trial import Trial

THINNING = 8
BINS = 64


def opening_percent(reference: np.ndarray, y: np.ndarray) -> float:
    """Widest opening of the loops in percent of the range: the largest spread of y over references that are nearly the same."""
    share = (reference + AMPLITUDE_UM) / RANGE_UM
    bins = np.clip((share * BINS).astype(int), 0, BINS - 1)
    error = y - reference
    return 100.0 / RANGE_UM * max(float(np.ptp(error[bins == i])) for i in range(BINS) if np.any(bins == i))


def exhibit(straight: Trial, learned: Trial) -> Exhibit:
    """Draw the loops of both axes, and what is left of them on a finer scale."""
    arrived = round(learned.rig.step_s / learned.rig.sample_time)  # before that the stage comes from the staircase
    reference, before, after = (values[arrived:] for values in (learned.rig.loop_ref, straight.loop, learned.loop))
    table = pd.DataFrame({f"{axis}_{what}_um": values[::THINNING, i] for i, axis in enumerate(AXES)
                          for what, values in (("reference", reference), ("straight", before), ("learned", after))})

    def row(i: int) -> tuple[alt.TopLevelMixin, alt.TopLevelMixin]:
        at, x = slice(None, None, THINNING), axis("reference, µm", domain=[-1.05 * AMPLITUDE_UM, 1.05 * AMPLITUDE_UM])
        left = 1e3 * (after - reference)[at, i]
        return (plot([Line("straight line", reference[at, i], before[at, i], STRAIGHT, width=1.0),
                      Line("compensated", reference[at, i], after[at, i], LEARNED, width=1.0)],
                     x, axis("measured position, µm"), 340, 230, f"axis {AXES[i]}"),
                plot([Line("zero", reference[[0, -1], i], np.zeros(2), REFERENCE, width=0.6),
                      Line("compensated", reference[at, i], left, LEARNED, width=0.8)], x, axis("compensated error, nm"), 340, 140,
                     legend=False))

    positions, errors = zip(*(row(i) for i in range(len(AXES))), strict=True)
    chart = above(beside(*positions), beside(*errors, y="shared"))
    widths = [(opening_percent(reference[:, i], before[:, i]), opening_percent(reference[:, i], after[:, i]))
              for i in range(len(AXES))]
    sentences = tuple(f"Axis {name}: the loops open by {wide:.1f} % of range along a straight line and by {narrow:.2f} % with "
                      "compensation, on a signal that was never learned from."
                      for name, (wide, narrow) in zip(AXES, widths, strict=True))
    return Exhibit("loops", "Hysteresis loops before and after",
                   "Measured position over reference for triangles of falling amplitude; below, what compensation leaves, in nm.",
                   sentences, table, chart)
