"""The figures beside the experiment and the timings of kernels and banks, each by its script in its shortest form: what
its numbers say, and that it says it. Situations drawn at random are repeatable, of every kind, and such that learning
in them ends near the floor."""

from pathlib import Path

import actuators
import numpy as np
import pandas as pd
import pytest
import robustness
from bank import by_count
from command_line import run_example
from disturbed_sensor import DisturbedSensor
from hypothesis import given, settings
from hypothesis import strategies as st
from references import changing_amplitude, from_samples, set_point_steps
from situations import REFERENCES, Situation
from two_axis_stage import QUICK, Setup

from piezo_model import plants


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
    assert last["model from excite"] == pytest.approx(last["the stage"], abs=0.2)
    page = (Path(__file__).parents[2] / "docs/what-to-record.md").read_text(encoding="utf-8")
    assert all(f" {each} %" in said and each in page for each in ("0.05", "0.07", "1.4", "0.1"))


@pytest.mark.slow
def test_situations_drawn_at_random_are_counted_by_their_distance_from_the_floor(tmp_path: Path) -> None:
    t, said = made(tmp_path, "robustness", "robustness", "--situations", 1, "--first", 5001)
    assert t["way"].nunique() == said.count(" of 1 situations end within 1.5 times the floor") == 3


@pytest.mark.slow
def test_integral_action_beside_the_compensation_is_better_than_either_alone(tmp_path: Path) -> None:
    t, said = made(tmp_path, "feedback", "feedback", "--situations", 1)
    errors = t.pivot(index=["seed", "disturbance"], columns="way", values="rms_percent")
    both = errors.pop("compensation and integral action")
    assert len(both) == said.count("Disturbance ") == 3
    assert (both < errors.min(axis=1)).all()


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


T = 1e-3


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_a_seed_is_a_situation_in_which_the_reference_can_be_reached(seed: int) -> None:
    situation, again = (Situation.draw(seed, 12.0, T) for _ in range(2))
    assert (situation.plant, situation.actuator_options) == (again.plant, again.actuator_options)
    low, high = situation.x_limits
    x = np.interp(np.arange(4000), (0, 2000, 4000), (low, high, low))
    y = situation.sensor().run(x)
    np.testing.assert_equal((situation.y_ref, y), (again.y_ref, again.sensor().run(x)))
    assert np.nanmin(y) < situation.y_ref.min() + 0.02 * np.ptp(y[np.isfinite(y)])
    assert np.nanmax(y) > situation.y_ref.max()
    assert situation.structure().d == 19


def test_the_disturbances_of_a_sensor_have_their_sizes_however_a_run_is_cut() -> None:
    x, t = np.repeat([0.0, 150.0], [100, 900]), T * np.arange(900)
    plain, swinging, lagging, gapped = (
        DisturbedSensor(plants.get("duhem", sample_time=T, creep_share=0.0), **options)
        for options in ({}, {"gain_swing": 0.1}, {"lag_s": 0.05}, {"gap_samples": 3, "gap_period_samples": 50})
    )
    y, m = plain.run(x), np.concatenate([lagging.run(part) for part in np.split(x, [1, 333])])
    np.testing.assert_allclose((y - m)[100:] / np.ptp(y), np.exp(-(t + T) / 0.05), atol=1e-9)
    swing = 1.0 + 0.1 * np.sin(0.2 * np.pi * T * np.arange(1000))
    np.testing.assert_allclose(swinging.run(x), swing * y, atol=1e-9)
    assert np.flatnonzero(np.isnan(gapped.run(x))).tolist() == [k for k in range(1000) if k % 50 >= 47]


def test_every_kind_of_actuator_and_reference_is_drawn_and_individuals_differ() -> None:
    drawn = [Situation.draw(seed, 1.0, T) for seed in range(60)]
    assert {situation.plant for situation in drawn} == set(plants.names())
    assert {situation.reference for situation in drawn} == set(REFERENCES)
    assert len(plants.names()) >= 5
    assert len(REFERENCES) >= 7
    assert len({tuple(situation.actuator_options.items()) for situation in drawn}) == len(drawn)


def test_a_chosen_reference_changes_nothing_but_the_reference() -> None:
    one, other = Situation.draw(3, 1.0, T, "staircase"), Situation.draw(3, 1.0, T, "random_walk")
    assert (one.plant, one.actuator_options, one.x_range, one.y_range) == (
        other.plant,
        other.actuator_options,
        other.x_range,
        other.y_range,
    )


@settings(max_examples=20, deadline=None)
@given(low=st.floats(-1e3, 1e3), width=st.floats(1e-3, 1e3), seconds=st.floats(0.05, 3.0), seed=st.integers(0, 2**31))
def test_every_reference_stays_inside_its_limits(low: float, width: float, seconds: float, seed: int) -> None:
    options = {"duration_s": seconds, "sample_time": 1e-3, "low": low, "high": low + width}
    for s in (
        set_point_steps(**options, seed=seed),
        changing_amplitude(**options, seed=seed),
        from_samples(np.random.default_rng(seed).normal(size=9), **options),
    ):
        assert s.shape == (round(seconds / 1e-3),)
        assert low <= s.min() <= s.max() <= low + width


def test_set_points_are_held_for_their_mean_time_and_no_step_is_a_jump() -> None:
    s = set_point_steps(duration_s=200.0, sample_time=1e-3, low=0.0, high=1.0, seed=1, mean_hold_s=0.5, step_s=0.02)
    assert np.sum(np.diff((np.abs(np.diff(s)) > 1e-9).astype(int)) == 1) == pytest.approx(400, rel=0.15)
    assert np.max(np.abs(np.diff(s))) < 0.12


def test_every_piece_has_an_amplitude_of_its_own() -> None:
    s = changing_amplitude(duration_s=40.0, sample_time=1e-3, low=-1.0, high=1.0, seed=4, piece_s=5.0, frequency_Hz=2.0)
    spans = [np.ptp(piece[500:]) for piece in np.split(s, 8)]
    assert max(spans) > 2.0 * min(spans)
    assert min(spans) > 0.3 * 0.95


@pytest.mark.slow
def test_every_way_ends_near_the_floor_and_far_from_the_straight_line() -> None:
    rows = pd.DataFrame([row for seed in (5, 6, 14) for row in robustness.rows(seed)])
    assert (rows.cycle_5 < 0.5 * rows.straight).all()
    assert (rows.ratio < 3.0).all()
    assert (rows[rows.way == "continuous"].ratio < 1.5).all()
