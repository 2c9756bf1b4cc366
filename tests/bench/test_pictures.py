"""Tables of the figures of a one-shot race that the committed run does not exercise: failed settings, the profile of
Dolan and Moré by hand, times by size."""

from collections.abc import Callable

import pandas as pd
import pytest
from measured_rows import ladder, measured

from bench.derived import pictures
from bench.derived.measurements import Measurements
from bench.messages.task import Row

NAN = float("nan")
SPEED = {"box_active_set": 1.0, "recursive_active_set": 2.0, "a": 3.0, "b": 4.0, "c": 5.0, "d": 6.0, "e": 7.0, "f": 8.0}
SIZES = (8, 18, 60)


@pytest.mark.parametrize("status", ["solver_failed", "not_run", "crashed", "tampered"])
def test_a_setting_that_fails_was_not_run_or_was_caught_on_any_problem_is_not_in_the_picture(status: str) -> None:
    rows = ladder({"p1": [1e-3, 1e-9, 1e-10], "p2": [1e-3, 1e-9, 1e-10]})
    rows[4]["status"] = status
    assert pictures.work_precision(measured(rows)).rung.tolist() == [0, 2]


def test_a_solver_is_drawn_in_its_fastest_lane_and_named_at_its_most_exact_setting_if_it_is_known() -> None:
    gaps = {"p1": [1e-3, 1e-9], "p2": [1e-3, 1e-9]}
    rows = [
        *ladder(gaps, solver="osqp", solve_us_p50=30.0),
        *ladder(gaps, solver="osqp", lane="qpsolvers", solve_us_p50=300.0),
        *ladder(gaps, solver="unknown", solve_us_p50=5.0),
        *ladder({"p1": [1e-12]}, solver="partial", solve_us_p50=1.0),
    ]
    table = pictures.work_precision(measured(rows)).set_index("name")
    assert set(table.index) == {"osqp", "unknown"}
    assert set(table.lane) == {"direct"}
    assert table.front.to_dict() == {"osqp": True, "unknown": False}
    assert table.loc["osqp"].end.tolist() == [False, True]


def timed(solver: str, times: list[float], gaps: list[float]) -> list[Row]:
    return [
        one
        for i, (us, gap) in enumerate(zip(times, gaps, strict=True))
        for one in ladder({f"p{i}": [gap]}, solver=solver, solve_us_p50=us)
    ]


def test_the_performance_profile_is_that_of_dolan_and_more() -> None:
    rows = [
        *timed("a", [1.0, 2.0, 9.0], [0.0] * 3),
        *timed("b", [2.0, 1.0, 3.0], [0.0] * 3),
        *timed("c", [0.1] * 3, [1e-3] * 3),
    ]
    table = pictures.performance_profile(measured(rows)).set_index(["solver", "factor"])
    expected = {
        ("a", 1.0): 1 / 3,
        ("a", 2.0): 2 / 3,
        ("a", 3.0): 1.0,
        ("b", 1.0): 2 / 3,
        ("b", 2.0): 1.0,
        ("b", 3.0): 1.0,
    }
    assert table.share.to_dict() == pytest.approx(expected)


def sized(**change: object) -> list[Row]:
    """Solvers whose time is a multiple of d, in two lanes; "a" is wrong at the largest size."""
    return [
        one
        for solver, speed in SPEED.items()
        for lane in ("direct", "qpsolvers")
        for d in SIZES
        for one in ladder(
            {f"d{d}": [1.0 if solver == "a" and d == 60 else 0.0]},
            problem_set="orders",
            d=d,
            solver=solver,
            lane=lane,
            solve_us_p50=speed * d * (1.0 if lane == "direct" else 1.5),
            **change,
        )
    ]


def test_our_solvers_stand_first_and_the_five_fastest_others_follow_in_their_fastest_lane() -> None:
    table = pictures.time_by_size(measured(sized()))
    assert table.name.tolist()[:4] == [
        "box_active_set† (direct)",
        "box_active_set† (qpsolvers)",
        "recursive_active_set† (direct)",
        "recursive_active_set† (qpsolvers)",
    ]
    assert table.name.tolist()[4:] == [f"{solver} (direct)" for solver in "bcdef"]
    assert table[18].iloc[-1] == 8.0 * 18


def test_a_size_of_several_problems_has_their_median_if_all_are_right() -> None:
    more = [
        *sized(),
        *ladder({"again": [0.0]}, problem_set="orders", d=8, solver="b", solve_us_p50=100.0),
        *ladder({"again": [1.0]}, problem_set="orders", d=8, solver="c", solve_us_p50=100.0),
    ]
    lines = pictures.sizes(measured(more)).set_index(["name", "d"])
    assert lines.time_us["b (direct)", 8] == (32.0 + 100.0) / 2
    assert lines.problems["b (direct)", 8] == 2
    assert ("c (direct)", 8) not in lines.index


def test_solvers_right_at_every_size_come_first_in_the_order_of_their_times() -> None:
    lines = pictures.sizes(measured(sized()))
    names = lines.name.drop_duplicates().tolist()
    assert names[:2] == ["box_active_set† (direct)", "box_active_set† (qpsolvers)"]
    assert {*names[-2:]} == {"a (direct)", "a (qpsolvers)"}


@pytest.mark.parametrize(
    ("picture_of", "rows"),
    [
        pytest.param(pictures.performance_profile, timed("a", [1.0], [1.0]), id="nothing is right"),
        pytest.param(pictures.time_by_size, [one for one in sized() if one["d"] == 18], id="one size"),
        pytest.param(pictures.sizes, sized(settings='{"steps": 5}'), id="methods that count steps"),
    ],
)
def test_a_picture_without_comparable_solvers_is_empty(
    picture_of: Callable[[Measurements], pd.DataFrame], rows: list[Row]
) -> None:
    assert picture_of(measured(rows)).empty
