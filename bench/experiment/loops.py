"""Hysteresis loops before and after: the measured position over the reference, for triangles of falling amplitude."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bench.experiment.style import LEARNED, REFERENCE, STRAIGHT, Exhibit
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

    def draw(figure: Figure) -> None:
        grid = figure.subplots(2, 2, sharex=True, height_ratios=(3, 2))
        for i, name in enumerate(AXES):
            above, below = grid[0, i], grid[1, i]
            for y, colour, label in ((before, STRAIGHT, "straight line"), (after, LEARNED, "compensated")):
                above.plot(reference[::THINNING, i], y[::THINNING, i], color=colour, lw=1.0, label=label)
            above.set(title=f"axis {name}", xlim=(-1.05 * AMPLITUDE_UM, 1.05 * AMPLITUDE_UM))
            below.plot(reference[::THINNING, i], 1e3 * (after - reference)[::THINNING, i], color=LEARNED, lw=0.8)
            below.axhline(0.0, color=REFERENCE, lw=0.6)
            below.set(xlabel="reference, µm")
        grid[0, 0].legend(loc="upper left")
        grid[0, 0].set_ylabel("measured position, µm")
        grid[1, 0].set_ylabel("compensated error, nm")

    widths = [(opening_percent(reference[:, i], before[:, i]), opening_percent(reference[:, i], after[:, i]))
              for i in range(len(AXES))]
    sentences = tuple(f"Axis {name}: the loops open by {wide:.1f} % of range along a straight line and by {narrow:.2f} % with "
                      "compensation, on a signal that was never learned from."
                      for name, (wide, narrow) in zip(AXES, widths, strict=True))
    return Exhibit("loops", "Hysteresis loops before and after",
                   "Measured position over reference for triangles of falling amplitude; below, what compensation leaves, in nm.",
                   sentences, table, draw, 5.6)
