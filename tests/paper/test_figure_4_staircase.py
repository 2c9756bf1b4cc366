"""Fig. 4: a staircase without compensation and with the self-learning one, on a simulated stage."""

import numpy as np
import pytest
from figures import Figures

from bench.rig import trial
from bench.rig.rig import AMPLITUDE_UM, Rig


@pytest.mark.parametrize("axis", ["x", "y"])
def test_learning_follows_the_staircase_far_better_than_any_straight_line(figures: Figures, axis: str) -> None:
    t = figures.table(f"fig4_staircase_{axis}")
    straight, hindsight, learned = (float(np.sqrt(np.mean((t[f"{run}_um"] - t.reference_um) ** 2)))
                                    for run in ("straight", "hindsight", "learned"))
    assert t.reference_um.max() == pytest.approx(AMPLITUDE_UM)
    assert learned < 0.1 * hindsight
    assert learned < 0.1 * straight


def test_the_line_of_hindsight_is_the_best_of_its_neighbours() -> None:
    rig = Rig.quick(cycles=2)
    slope, offset_V = trial.lines(rig)
    best = trial.best_straight(rig)
    assert (best.rms_percent() <= trial.straight(rig).rms_percent() * 1.02).all()
    for shift in (0.97, 1.03):
        assert (best.rms_percent() <= trial.straight(rig, shift * slope, offset_V).rms_percent() * 1.02).all()


def test_the_error_falls_with_the_cycles_and_drift_calls_for_learning_on(figures: Figures) -> None:
    t = figures.table("cycles")
    learned = t.learned_percent.dropna()
    assert learned.iloc[-1] < 0.1 * learned.iloc[0]
    assert t.learned_drifting_percent.iloc[-1] < t.learned_once_drifting_percent.iloc[-1]


def test_loops_close_under_compensation(figures: Figures) -> None:
    t = figures.table("loops")
    for axis in ("x", "y"):
        straight, learned = (np.abs(t[f"{axis}_{run}_um"] - t[f"{axis}_reference_um"]).max() for run in ("straight", "learned"))
        assert learned < 0.4 * straight
