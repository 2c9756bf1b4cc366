"""The experiment, run once in its quick form: what it writes, and that its numbers say what the page says."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine, Finished

from bench.experiment import boundary
from bench.rig import trial
from bench.rig.rig import AMPLITUDE_UM, Rig

FIGURES = ("fig4_staircase_x", "fig4_staircase_y", "loops", "cycles", "actuators", "push_pull", "robustness", "feedback", "fig1_operators",
           "fig2_boundary")


@pytest.fixture(scope="module")
def made(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Finished]:
    folder = tmp_path_factory.mktemp("experiment") / "figures"
    return folder, piezobench("experiment", "--quick", "--seed", 1, "--solver", "box_active_set", "--out", folder)


@pytest.fixture(scope="module")
def folder(made: tuple[Path, Finished]) -> Path:
    assert made[1].status == 0, made[1].stderr
    return made[0]


def table(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_csv(folder / f"{name}.csv")


def test_every_figure_is_there_as_png_svg_and_numbers_and_stands_on_the_page(folder: Path) -> None:
    page = (folder / "experiment.md").read_text(encoding="utf-8")
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        ["experiment.md", *(f"{name}.{ending}" for name in FIGURES for ending in ("csv", "png", "svg"))])
    for name in FIGURES:
        assert f"({name}.svg)" in page
        assert f"({name}.csv)" in page
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (folder / f"{name}.svg").read_text(encoding="utf-8")
        assert len(table(folder, name)) > 1


def test_the_verdict_is_said_on_the_terminal_and_on_the_page(made: tuple[Path, Finished], folder: Path) -> None:
    verdict = made[1].stdout.splitlines()[0]
    assert verdict.startswith("Self-learning compensation brings the stage from")
    assert verdict in (folder / "experiment.md").read_text(encoding="utf-8")
    assert made[1].stderr == ""


@pytest.mark.parametrize("axis", ["x", "y"])
def test_learning_follows_the_staircase_far_better_than_any_straight_line(folder: Path, axis: str) -> None:
    t = table(folder, f"fig4_staircase_{axis}")
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


def test_the_error_falls_with_the_cycles_and_drift_calls_for_learning_on(folder: Path) -> None:
    t = table(folder, "cycles")
    learned = t.learned_percent.dropna()
    assert learned.iloc[-1] < 0.1 * learned.iloc[0]
    assert t.learned_drifting_percent.iloc[-1] < t.learned_once_drifting_percent.iloc[-1]


def test_in_situations_drawn_at_random_learning_ends_nearer_than_a_straight_line(folder: Path) -> None:
    t = table(folder, "robustness")
    assert t["way"].nunique() == 3
    assert (t.cycle_5 < t.straight).all()
    assert (t[t["way"] == "continuous"].ratio < 2.0).all()


def test_integral_action_beside_the_compensation_is_better_than_either_alone(folder: Path) -> None:
    errors = table(folder, "feedback").pivot(index=["seed", "disturbance"], columns="way", values="rms_percent")
    both = errors.pop("compensation and integral action")
    assert len(both) == 3
    assert (both < errors.min(axis=1)).all()


def test_loops_close_under_compensation(folder: Path) -> None:
    t = table(folder, "loops")
    for axis in ("x", "y"):
        straight, learned = (np.abs(t[f"{axis}_{run}_um"] - t[f"{axis}_reference_um"]).max() for run in ("straight", "learned"))
        assert learned < 0.4 * straight


def test_one_curved_actuator_needs_s_and_two_in_push_pull_do_not(folder: Path) -> None:
    t = table(folder, "push_pull").set_index(["kind", "n", "push_pull", "m"]).rms_percent
    assert t["curved", 10, False, 0] > 5.0 * t["curved", 10, False, 3]
    assert t["curved", 10, True, 0] <= 1.1 * t["curved", 10, True, 3]
    page = (folder / "experiment.md").read_text(encoding="utf-8")
    said = re.search(r"Curved actuators, n = 10: with one actuator .* is ([\d.]+) times .* without S is as good as with it", page)
    assert said is not None
    assert float(said[1]) == pytest.approx(t["curved", 10, False, 0] / t["curved", 10, False, 3], abs=0.06)


def test_the_trajectory_meets_the_boundary_slides_along_it_and_never_leaves_the_set(folder: Path) -> None:
    t = table(folder, "fig2_boundary")
    first = int(np.argmax(t.on_boundary))
    assert not t.on_boundary.iloc[0]
    assert t.on_boundary.iloc[first:].all()
    assert (t.w_held >= t.w_held.iloc[-1]).all()
    assert (t.unprojected_held[first:] < t.w_held.iloc[-1]).all()
    assert np.ptp(t.w_free[first:]) > 0.0


def test_the_trajectory_ends_at_the_optimum_of_the_whole_problem() -> None:
    part = boundary.Slice(("a", "b"), np.array([[1.0, 0.6], [0.6, 1.0]]), np.array([0.5, -1.0]), np.zeros(2), np.array([0.0, 1.0]))
    path, free = boundary.trajectory(part, np.array([1.0, 3.0]), steps=2000)
    np.testing.assert_allclose(path[-1], part.optimum, atol=1e-9)
    np.testing.assert_allclose(path[1:], np.maximum(free[:-1], 0.0), atol=1e-12)


def test_the_seed_makes_the_experiment_and_nothing_else_does() -> None:
    def errors(seed: int) -> np.ndarray:
        return trial.learned(Rig.quick(cycles=1, seed=seed, solver="box_active_set", samples_to_solve=1)).error_um

    np.testing.assert_array_equal(errors(3), errors(3))
    assert not np.array_equal(errors(3), errors(4))


def test_what_cannot_be_made_is_refused_in_one_sentence(piezobench: CommandLine, tmp_path: Path) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("")
    assert "is no folder" in piezobench("experiment", "--out", occupied).refusal
    assert "there is no solver 'magic'" in piezobench("experiment", "--solver", "magic", "--out", tmp_path).refusal
    assert list(tmp_path.iterdir()) == [occupied]


def test_on_actuators_outside_the_model_class_learning_ends_near_the_best_that_the_class_can_do(folder: Path) -> None:
    t = table(folder, "actuators")
    last = t[[name for name in t if name.startswith("cycle_")][-1]]
    assert set(t["mode"]) == {"cyclic", "continuous"}
    assert (last < 0.2 * t.best_straight_percent).all()
    assert (t.best_straight_percent <= t.straight_percent).all()
    assert (t.hindsight_percent < 1.1 * last).all()  # else it would not be the best
