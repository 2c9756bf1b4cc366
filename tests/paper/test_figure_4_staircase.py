"""Fig. 4: a staircase without compensation and with self-learning compensation, on a simulated stage."""

import numpy as np
import pytest
from figures import Figures
from programs import library

library("pandas")
from bench.stage import trial  # noqa: E402
from bench.stage.setup import AMPLITUDE_UM, StageSetup  # noqa: E402


@pytest.mark.parametrize("axis", ["x", "y"])
def test_learning_follows_the_staircase_far_better_than_any_straight_line(figures: Figures, axis: str) -> None:
    t = figures.table(f"fig4_staircase_{axis}")
    rms = np.sqrt(t.assign(square=t.error_um**2).groupby("name").square.mean())
    assert t[t.name == "reference"].position_um.max() == pytest.approx(AMPLITUDE_UM)
    assert rms["self-learning"] < 0.1 * rms["best straight line with hindsight"]
    assert rms["self-learning"] < 0.1 * rms["straight line"]


def test_the_line_of_hindsight_is_the_best_of_its_neighbours() -> None:
    setup = StageSetup.quick(cycles=2)
    slope, offset_V = trial.lines(setup)
    best = trial.best_straight(setup)
    assert (best.rms_percent() <= trial.straight(setup).rms_percent() * 1.02).all()
    for shift in (0.97, 1.03):
        assert (best.rms_percent() <= trial.straight(setup, shift * slope, offset_V).rms_percent() * 1.02).all()


def test_the_error_falls_with_the_cycles_and_drift_calls_for_learning_on(figures: Figures) -> None:
    t = figures.table("cycles").set_index(["stage", "name"]).percent.sort_index(kind="stable")
    learned = t["steady", "self-learning"]
    assert learned.iloc[-1] < 0.1 * learned.iloc[0]
    assert t["drifting", "self-learning"].iloc[-1] < t["drifting", "learned for 2 cycles, then fixed"].iloc[-1]


def test_loops_close_under_compensation(figures: Figures) -> None:
    largest = figures.table("loops").groupby(["axis", "name"]).error_um.agg(lambda error: error.abs().max())
    for axis in ("x", "y"):
        assert largest[axis, "self-learning"] < 0.4 * largest[axis, "straight line"]
