"""What the plots of a one-shot race show: work and precision, the profile of Dolan and Moré, time by size, and where
the time goes."""

from collections.abc import Callable

import pandas as pd
import pytest
from measured_rows import ladder, measured, row, steps

from bench.derived import pictures
from bench.derived.measurements import Measurements
from bench.derived.ranking import PACE, PAPER
from bench.derived.summary import summary
from bench.messages.task import Row
from bench.report.plot import BEST

NAN = float("nan")
SPEED = {"box_active_set": 1.0, "recursive_active_set": 2.0, "a": 3.0, "b": 4.0, "c": 5.0, "d": 6.0, "e": 7.0, "f": 8.0}
SIZES = (8, 18, 60)


def picture(rows: list[Row]) -> pd.DataFrame:
    return pictures.work_precision(measured(rows))


def test_a_point_is_a_setting_with_its_worst_gap_and_median_time_over_all_problems() -> None:
    table = picture(
        [
            *ladder({"p1": [1e-3, 1e-9]}, solve_us_p50=[1.0, 10.0]),
            *ladder({"p2": [1e-5, 1e-7]}, solve_us_p50=[2.0, 20.0]),
            *ladder({"p3": [1e-4, 1e-8]}, update_us=1.0, solve_us_p50=[5.0, 50.0]),
        ]
    )
    assert table[["rung", "problems", "worst_cost_gap", "total_us"]].to_numpy().tolist() == [
        [0, 3, 1e-3, 2.0],
        [1, 3, 1e-7, 20.0],
    ]
    assert (table["view"] == "scaled data, without wrappers").all()


@pytest.mark.parametrize("status", ["solver_failed", "not_run", "crashed", "cached", "mistimed"])
def test_a_setting_that_fails_was_not_run_or_was_caught_on_any_problem_is_not_in_the_picture(status: str) -> None:
    rows = ladder({"p1": [1e-3, 1e-9, 1e-10], "p2": [1e-3, 1e-9, 1e-10]})
    rows[4]["status"] = status
    if status not in ("cached", "mistimed"):
        rows[4]["cost_gap"] = NAN
        assert picture(rows).rung.tolist() == [0, 2]
    else:
        assert picture(rows).empty


def test_the_default_is_marked_whether_it_is_in_the_ladder_or_not() -> None:
    inside = picture(ladder({"p1": [1e-3, 1e-9]}, is_default=[False, True]))
    assert inside.is_default.tolist() == [False, True]
    outside = picture([row(setting="d", rung=-1, is_default=True, cost_gap=1e-2), *ladder({"p1": [1e-3]})])
    assert outside[["rung", "is_default"]].to_numpy().tolist() == [[-1, True], [0, False]]


def test_wrappers_and_scalings_have_views_of_their_own_and_floor_and_warm_starts_none() -> None:
    table = picture(
        [
            row(),
            row(lane="cvxpy", solve_us_p50=9.0),
            row(scaling="raw"),
            row(solver="null"),
            row(start="warm", cost_gap=0.5),
        ]
    )
    assert table["view"].tolist() == [
        "scaled data, without wrappers",
        "scaled data, qpsolvers and cvxpy",
        "raw data, without wrappers",
    ]
    assert table.name.tolist() == ["daqp", "daqp (cvxpy)", "daqp"]
    assert (table.worst_cost_gap == 0.0).all()


def test_the_papers_method_is_there_twice_at_the_pace_of_its_samples_and_of_the_machine() -> None:
    table = picture(
        [
            *steps({"p1": [0.5, 1e-4]}, solve_us_p50=[2.0, 300.0]),
            row(),
        ]
    )
    assert table[table.name == PACE].total_us.tolist() == [12_500.0, 1.9e6]
    assert table[table.name == PACE].front.all()
    assert table[table.name == f"{PAPER}† (kernel)"].total_us.tolist() == [2.0, 300.0]
    assert set(table.label) == {PACE, pictures.OUR_LINES, pictures.OTHER_LINES}


def test_the_best_lines_of_each_view_come_first_and_are_marked() -> None:
    names = [chr(ord("a") + i) for i in range(BEST + 2)]
    table = pd.DataFrame({"view": "one", "name": [*names, "a"], "score": [*range(BEST + 2, 0, -1), 0.5]})
    found = pictures.ranked(pd.concat([table, table[:2].assign(view="two")]), table.score)
    assert found["view"].tolist() == ["one"] * (BEST + 3) + ["two"] * 2
    assert found.name.tolist() == ["a", "a", *names[:0:-1], "b", "a"]
    assert found.name[~found.front].tolist() == ["c", "b"]


def profile(rows: list[Row]) -> dict[tuple[str, float], float]:
    """ρ by solver and factor."""
    return {
        (line.solver, line.factor): line.share for line in pictures.performance_profile(measured(rows)).itertuples()
    }


def timed(solver: str, times: list[float], gaps: list[float]) -> list[Row]:
    return [
        one
        for i, (us, gap) in enumerate(zip(times, gaps, strict=True))
        for one in ladder({f"p{i}": [gap]}, solver=solver, solve_us_p50=us)
    ]


def test_the_performance_profile_is_that_of_dolan_and_more() -> None:
    shares = profile(
        [
            *timed("a", [1.0, 2.0, 9.0], [0.0] * 3),
            *timed("b", [2.0, 1.0, 3.0], [0.0] * 3),
            *timed("c", [0.1] * 3, [1e-3] * 3),
        ]
    )
    assert shares["a", 1.0] == pytest.approx(1 / 3)
    assert shares["b", 1.0] == pytest.approx(2 / 3)
    assert shares["a", 2.0] == pytest.approx(2 / 3)
    assert shares["a", 3.0] == shares["b", 3.0] == 1.0
    assert "c" not in {solver for solver, _ in shares}


def test_a_solver_that_misses_the_tier_has_the_share_of_problems_on_which_its_furthest_setting_is_right() -> None:
    shares = profile([*timed("a", [1.0, 1.0], [0.0, 0.0]), *timed("b", [2.0, 2.0], [0.0, 1e-3])])
    assert shares["b", 2.0] == 0.5
    assert shares["a", 2.0] == 1.0


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


def test_a_size_of_several_problems_has_their_median_where_all_are_right() -> None:
    more = [
        *sized(),
        *ladder({"again": [0.0]}, problem_set="orders", d=8, solver="b", solve_us_p50=100.0),
        *ladder({"again": [1.0]}, problem_set="orders", d=8, solver="c", solve_us_p50=100.0),
    ]
    lines = pictures.sizes(measured(more)).set_index(["name", "d"])
    assert lines.time_us["b (direct)", 8] == (32.0 + 100.0) / 2
    assert lines.problems["b (direct)", 8] == 2
    assert ("c (direct)", 8) not in lines.index


def test_those_that_are_right_at_every_size_come_before_those_that_are_not_and_the_fastest_first() -> None:
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
def test_a_picture_of_what_it_cannot_compare_is_empty(
    picture_of: Callable[[Measurements], pd.DataFrame], rows: list[Row]
) -> None:
    assert picture_of(measured(rows)).empty


def test_the_parts_of_an_answer_are_those_of_the_most_exact_tier_that_a_lane_reaches_preferring_a_billionth() -> None:
    found = measured(
        [
            *ladder({"p1": [1e-5, 1e-14]}, setup_us=[1.0, 10.0], update_us=[2.0, 4.0], solve_us_p50=[3.0, 6.0]),
            *ladder({"p1": [1e-5]}, solver="scs", setup_us=1.0, update_us=1.0, solve_us_p50=2.0),
            row(solver="null"),
        ]
    )
    table = pictures.stages(summary(found)).set_index(["solver", "stage"])
    assert table.us["daqp"].tolist() == [10.0, 4.0, 6.0]
    assert table.share["daqp"].tolist() == [0.5, 0.2, 0.3]
    assert table.tier.groupby("solver").first().to_dict() == {"daqp": "high", "scs": "low"}
    assert (table.update_and_solve_us["scs"] == 3.0).all()
