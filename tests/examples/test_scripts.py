"""The figures beside the experiment and the timings of kernels and banks, each by its script in its shortest form: what
its numbers say, and that it says it."""

from pathlib import Path

import actuators
import pandas as pd
import pytest
from bank import by_count
from command_line import run_example
from two_axis_stage import QUICK, Setup

PAGE = Path(__file__).parents[2] / "docs/what-to-record.md"


def made(folder: Path, script: str, name: str, *words: object) -> tuple[pd.DataFrame, str]:
    """The numbers of a figure, and what its script prints."""
    said = run_example(f"paper/{script}.py", "--out", folder, *words)
    assert "<svg" in (folder / f"{name}.svg").read_text(encoding="utf-8")
    return pd.read_csv(folder / "figures" / f"{name}.csv"), said


def test_creep_comes_to_rest_at_its_threshold(tmp_path: Path) -> None:
    t, said = made(tmp_path, "elementary_operators", "fig1_operators")
    assert abs(t[t.name == "rate 10 /s"].output.iloc[-1] - 0.4) < 1e-6
    assert "creep ends at r = 0.4" in said


def test_a_recording_of_one_frequency_leaves_creep_out_and_one_with_holds_finds_most_of_it(tmp_path: Path) -> None:
    t, said = made(tmp_path, "one_frequency", "one_frequency")
    last = t.groupby("name").moved.last()
    assert last["model from a triangle"] == pytest.approx(0.0, abs=0.01)
    assert last["the stage"] == pytest.approx(1.4, abs=0.1)
    assert last["model from excite"] == pytest.approx(last["the stage"], abs=0.6)
    figures = ("0.05", "0.09", "1.4", "0.4")
    assert all(f" {each} %" in said and f"{each}" in PAGE.read_text(encoding="utf-8") for each in figures)


@pytest.mark.slow
def test_situations_drawn_at_random_are_counted_by_their_distance_from_the_floor(tmp_path: Path) -> None:
    t, said = made(tmp_path, "robustness", "robustness", "--situations", 1, "--first", 5001)
    assert t["way"].nunique() == 3
    assert said.count(" of 1 situations end within 1.5 times the floor") == 3


@pytest.mark.slow
def test_integral_action_beside_the_compensation_is_better_than_either_alone(tmp_path: Path) -> None:
    t, said = made(tmp_path, "feedback", "feedback", "--situations", 1)
    errors = t.pivot(index=["seed", "disturbance"], columns="way", values="rms_percent")
    both = errors.pop("compensation and integral action")
    assert len(both) == 3
    assert (both < errors.min(axis=1)).all()
    assert said.count("Disturbance ") == 3


@pytest.mark.slow
def test_on_actuators_outside_the_model_class_learning_ends_near_the_best_that_the_class_can_do(tmp_path: Path) -> None:
    t, said = made(tmp_path, "actuators", "actuators", "--quick", "--seed", 1)
    last = t[t.cycle == t.cycle.max()].pivot(index="plant", columns="name", values="percent")
    learned = last[[name for name in last if "n = " in name]]
    assert list(learned) == ["continuous, n = 5, m = 3", "cyclic, n = 20, m = 7", "cyclic, n = 5, m = 3"]
    assert learned.lt(0.2 * last["best straight line"], axis=0).all(axis=None)
    assert (last["with hindsight"] < 1.1 * last["cyclic, n = 5, m = 3"]).all()  # else it would not be the best
    assert said.count(" times what hindsight gives") == learned.size


@pytest.mark.parametrize("plant", sorted({case.plant for case in actuators.CASES}))
def test_the_best_straight_line_is_no_worse_than_the_one_through_the_corners_of_the_ranges(plant: str) -> None:
    setup = Setup(**QUICK)
    sensor = actuators.sensor_of(plant, setup)
    straight, best = actuators.straight_lines(sensor, actuators.steps(sensor, setup)[-setup.cycle :])
    assert best <= straight


@pytest.mark.slow
def test_the_kernels_are_timed_beside_a_numpy_version_with_the_same_result() -> None:
    said = run_example("performance/kernels.py", 1)
    assert len(said.partition("data basis, d = 18, 3 creep rates, a sample")[2].splitlines()[0].split()) == 3, (
        "ours, NumPy's and the ratio"
    )
    assert "whole loop, box_active_set, continuous: learn" in said


def test_a_bank_is_stepped_in_real_time_beside_a_null_step() -> None:
    said = run_example("performance/bank.py", 9, 500, 0.1, 2)
    assert said.partition("a bank of 9, 2 threads")[2].split()[1:3] == ["–", "–"], "50 steps support a median alone"
    assert "a null step as long, the machine's floor" in said
    assert "Period 2000 µs, 10 exact optima a second of each" in said


def test_the_cost_of_a_bank_is_shown_by_its_size(capsys: pytest.CaptureFixture[str]) -> None:
    by_count((8,))
    assert capsys.readouterr().out.splitlines()[-1].split()[0] == "8"
