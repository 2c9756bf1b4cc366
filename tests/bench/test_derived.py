"""What is derived from a table of measurements: errors and tiers, the row of all repeats, the setting of a tier, the
large table, the cost of wrappers."""

import math
from itertools import permutations

import numpy as np
import pandas as pd
import pytest
from measured_rows import NAN, ladder, measured, row, table

from bench.derived.measurements import Measurements, merged
from bench.derived.ranking import BESIDE, like_with_like, wrapper_share
from bench.derived.summary import summary
from bench.derived.tiers import FEWEST, TOLERANCE, choice, error, leave_one_out, right, tier_settings
from bench.messages.task import Row, Status, Tier


def error_of(tier: Tier, **known: float | str) -> float:
    return float(error(table([row(**known)]), tier).item())


def is_right(tier: Tier, **known: float | str) -> bool:
    return bool(right(table([row(**known)]), tier).item())


@pytest.mark.parametrize("tier", TOLERANCE)
@pytest.mark.parametrize("part", ["cost_gap", "violation", "timed_gap"])
def test_the_error_is_the_largest_of_gap_violation_and_timed_gap_over_the_tolerance(tier: Tier, part: str) -> None:
    others = dict.fromkeys(("cost_gap", "violation", "timed_gap"), 0.25 * TOLERANCE[tier])
    assert error_of(tier, **others) == pytest.approx(0.25)
    assert error_of(tier, **others | {part: 3.0 * TOLERANCE[tier]}) == pytest.approx(3.0)
    changes = ({part: TOLERANCE[tier]}, {part: 1.01 * TOLERANCE[tier]}, {"cost_gap": -1e-17})  # rounding
    assert [is_right(tier, **others | change) for change in changes] == [True, False, True]


NOTICED = {"cost_gap": 0.5, "timed_gap": 0.5, "noise_um": 0.01}


@pytest.mark.parametrize(
    ("tier", "known", "expected"),
    [
        (Tier.HIGH, {"cost_gap": 1e-10, "timed_gap": NAN}, 0.1),  # timed answers that were not judged
        (Tier.HIGH, {"timed_gap": math.inf}, math.inf),
        *((tier, {"stage_excess": 0.0, "violation": NAN}, math.inf) for tier in (Tier.HIGH, Tier.STAGE)),
        (Tier.HIGH, {"cost_gap": NAN}, math.inf),
        # by the first answer alone
        (Tier.STAGE, {**NOTICED, "stage_excess": -3.0}, 0.0),
        (Tier.STAGE, {**NOTICED, "stage_excess": 0.05}, 0.5),
        (Tier.STAGE, {**NOTICED, "stage_excess": 0.2}, 2.0),
        (Tier.STAGE, {**NOTICED, "stage_excess": NAN}, math.inf),
        (Tier.STAGE, {**NOTICED, "stage_excess": 0.0, "violation": 2e-3}, 2.0),
    ],
)
def test_unknown_values_are_errors_and_the_stage_notices_a_hundredth_of_its_noise_or_a_violation(
    tier: Tier, known: dict[str, float], expected: float
) -> None:
    assert error_of(tier, **known) == pytest.approx(expected)


@pytest.mark.parametrize("status", [status for status in Status if status is not Status.ANSWERED])
def test_an_answer_whose_status_is_not_ok_has_an_infinite_error_however_small_its_gap(status: Status) -> None:
    assert (
        error_of(Tier.LOW, status=str(status)) == error_of(Tier.STAGE, status=str(status), stage_excess=0.0) == math.inf
    )
    assert not is_right(Tier.DEFAULT, status=str(status))


def settings(rows: list[Row]) -> pd.DataFrame:
    """The settings of a solver lane by tier."""
    return tier_settings(table(rows)).set_index("tier")


@pytest.mark.parametrize(
    ("gaps", "setting", "times"),
    [
        ({"p1": [3e-7, 8e-8, 1e-9], "p2": [1e-9, 9e-8, 1e-9]}, "s1", 10.0),
        ({"p1": [9e-7, 3e-7, 2e-7], "p2": [1e-9, 1e-9, 1e-9]}, "s1", 3.0),
        ({"p1": [9e-7, 8e-7, 7e-7], "p2": [1e-9, 1e-9, 1e-9]}, "s0", 1.0),
        ({"p1": [2e-6, 8e-7, 2e-6], "p2": [1e-9, 1e-9, 1e-9]}, "s1", 1.0),
    ],
)
def test_the_loosest_that_meets_a_tier_ten_times_over_on_every_problem_is_taken_else_three_times_else_once(
    gaps: dict[str, list[float]], setting: str, times: float
) -> None:
    found = settings(ladder(gaps)).loc[Tier.MID]
    expected = {"setting": setting, "rung": int(setting[1]), "margin": times, "furthest": setting}
    assert found[[*expected, "problems", "right"]].to_dict() == {**expected, "problems": 2, "right": 2}


def test_without_a_setting_right_on_every_problem_a_tier_is_not_reached_and_the_furthest_is_named() -> None:
    rows = ladder({"p1": [1e-5, 1e-8, 1e-8], "p2": [1e-5, 1e-5, 1e-8], "p3": [1e-8, 1e-8, 1e-5]})
    found = settings(rows).loc[Tier.MID]
    assert (found.setting, found.rung, found.problems, found.right, found.furthest) == ("", -1, 3, 2, "s1")
    assert np.isnan([found.margin, found.left_out]).all()


DEFAULT = row(setting="d", rung=-1, is_default=True)
NOT_RUN = {"setting": "s1", "rung": 1, "status": "not_run", "cost_gap": NAN}
NOISY = ladder({"p1": [0.5, 0.5], "p2": [0.5, 0.5]}, noise_um=0.01, stage_excess=[0.2, 0.01])
SILENT = ladder({"p3": [0.5, 0.5]}, noise_um=0.0)


@pytest.mark.parametrize(
    ("rows", "tier", "setting", "right", "problems"),
    [
        *(
            pytest.param(ladder({"p1": [NAN, 1e-14], "p2": [0.1, 1e-14]}), tier, "s1", 2, 2, id=f"tighter for {tier}")
            for tier in (Tier.LOW, Tier.MID, Tier.HIGH, Tier.EXACT)
        ),
        pytest.param([*NOISY, *SILENT], Tier.STAGE, "s1", 2, 2, id="the stage where the noise is known"),
        pytest.param([*NOISY, *SILENT], Tier.LOW, "", 0, 3, id="other tiers where the noise is not known"),
        pytest.param(
            [*ladder({"p1": [1e-12]}), *ladder({"p1": [1.0]}, problem_set="orders")], Tier.LOW, "", 1, 2, id="two sets"
        ),
        pytest.param(
            [*ladder({"p1": [1e-5, 1e-11]}), row(repeat=1, **NOT_RUN)], Tier.HIGH, "s1", 1, 1, id="not run in a repeat"
        ),
        pytest.param(ladder({"p1": [1e-8, 1e-11]}), Tier.MID, "s0", 1, 1, id="one repeat"),
        *(
            pytest.param(
                [*ladder({"p1": [1e-8, 1e-11]}), *ladder({"p1": [1e-5, 1e-11]}, **other)],
                Tier.MID,
                "s1",
                1,
                1,
                id=str(other),
            )
            for other in ({"repeat": 1}, {"host": "there"}, {"timed": "interleaved"})
        ),
        pytest.param([DEFAULT, *ladder({"p1": [0.5, 1e-8]})], Tier.MID, "s1", 1, 1, id="default beside the ladder"),
        pytest.param(ladder({"p1": [1e-8, 1e-8]}, is_default=[True, False]), Tier.MID, "s0", 1, 1, id="default in it"),
        pytest.param(
            [*ladder({"p1": [1e-5, 1e-8]}), *ladder({"p1": [1e-8, 1.0]}, start="warm")], Tier.MID, "s1", 1, 1, id="warm"
        ),
        pytest.param(
            [*ladder({"p1": [1e-5], "p2": [1e-5, 1e-12]}), row(**NOT_RUN)], Tier.HIGH, "", 1, 2, id="not run on one"
        ),
        pytest.param(ladder({"p1": [1e-5], "p2": [1e-5, 1e-12]}), Tier.HIGH, "", 1, 2, id="not there on one"),
        pytest.param(
            [*ladder({"p1": [1e-12], "p2": [1e-12]}), row(problem="p3", status="unsupported")],
            Tier.HIGH,
            "s0",
            2,
            2,
            id="unsupported on one",
        ),
    ],
)
def test_the_setting_of_a_tier_is_judged_by_all_cold_rows_of_the_ladder_on_the_problems_to_which_the_tier_applies(
    rows: list[Row], tier: Tier, setting: str, right: int, problems: int
) -> None:
    found = settings(rows).loc[tier]
    assert (found.setting, found.right, found.problems) == (setting, right, problems)
    assert np.isnan(found.margin) if setting == "" else found.margin == 10.0


@pytest.mark.parametrize("rows", [[], [DEFAULT]])
def test_without_a_ladder_there_are_no_settings(rows: list[Row]) -> None:
    assert tier_settings(table(rows)).empty


def test_the_share_is_empty_below_three_problems_and_if_a_tier_is_not_reached() -> None:
    assert FEWEST == 3
    assert settings(ladder({"p1": [1e-12], "p2": [1e-12]})).left_out.isna().all()
    three = settings(ladder({"p1": [1e-10], "p2": [1e-10], "p3": [1e-10]}))
    assert three.left_out[Tier.HIGH] == 1.0
    assert np.isnan(three.left_out[Tier.EXACT])


def test_a_problem_whose_others_reach_no_setting_counts_as_not_right() -> None:
    errors = np.array([[2.0, 0.5], [0.5, 0.5], [0.5, 2.0]])
    # without the first s0, without the last s1, and without the middle one none
    assert (choice(errors), leave_one_out(errors)) == (None, 0.0)


SKIPPED = row(status="not_run", message="a looser setting took longer", cost_gap=NAN, solve_us_p50=NAN, samples=0)
LOST = row(repeat=1, status="crashed", message="SIGSEGV", cost_gap=NAN, solve_us_p50=NAN)
FAILS = (row(repeat=2, status="missed", message="another", solve_us_p50=3.0), LOST, row(solve_us_p50=2.0))


@pytest.mark.parametrize(
    ("repeats", "expected"),
    [
        pytest.param(
            [
                row(
                    repeat=0,
                    solve_us_p50=2.0,
                    setup_us=9.0,
                    solve_us_max=5.0,
                    samples=5,
                    preemptions=1,
                    cost_gap=1e-9,
                    timed_gap=1e-8,
                    mutates_input=True,
                ),
                row(
                    repeat=1,
                    solve_us_p50=4.0,
                    setup_us=1.0,
                    solve_us_max=80.0,
                    samples=6,
                    preemptions=0,
                    cost_gap=1e-7,
                    timed_gap=1e-9,
                ),
                row(
                    repeat=2,
                    solve_us_p50=3.0,
                    setup_us=2.0,
                    solve_us_max=4.0,
                    samples=7,
                    preemptions=2,
                    cost_gap=1e-8,
                    timed_gap=1e-9,
                    repeatable=False,
                ),
            ],
            {
                "repeats": 3,
                "repeat": 0,
                "samples": 18,
                "preemptions": 3,
                "mutates_input": True,
                "repeatable": False,
                "solve_us_p50": 3.0,
                "setup_us": 2.0,
                "solve_us_max": 80.0,
                "cost_gap": 1e-7,
                "timed_gap": 1e-8,
                "answer_us_spread": pytest.approx((4.0 - 2.0) / 3.0),
            },
            id="medians, the spread, the largest and the sum",
        ),
        *(
            (
                order,
                {
                    "status": "crashed",
                    "message": "SIGSEGV",
                    "repeats": 3,
                    "solve_us_p50": 2.5,
                    "answer_us_spread": pytest.approx(0.4),
                },
            )
            for order in (FAILS, (FAILS[2], FAILS[1], FAILS[0]))
        ),
        *(
            (
                [{**(row(solve_us_p50=us, samples=5) if us else SKIPPED), "repeat": i} for i, us in enumerate(order)],
                {
                    "status": "answered",
                    "message": "",
                    "cost_gap": 0.0,
                    "repeats": 2,
                    "samples": 10,
                    "solve_us_p50": 3.0,
                },
            )
            for order in permutations((2.0, 4.0, 0.0))
        ),
        ([row(), {**SKIPPED, "repeat": 1}, {**LOST, "repeat": 2}], {"status": "crashed"}),
        ([SKIPPED, {**SKIPPED, "repeat": 1}], {"status": "not_run"}),
    ],
)
def test_repeats_become_one_row_whose_status_is_the_worst_and_one_in_which_a_setting_was_not_run_hides_no_other(
    repeats: list[Row], expected: dict[str, object]
) -> None:
    rows = table(repeats)
    one = merged(rows)
    assert one[[*expected]].to_dict("records") == [expected]
    assert one.columns.tolist() == [*rows.columns, "repeats", "answer_us_spread", "interleaved_us"]


def test_times_are_those_of_the_host_with_most_rows_and_settings_are_judged_by_all() -> None:
    found = measured(
        [
            *ladder({"p1": [1e-8, 1e-12], "p2": [1e-8, 1e-12]}, host="here", solve_us_p50=1.0, period_us=[125.0, 5e3]),
            *ladder({"p1": [1e-5, 1e-12]}, host="there", solve_us_p50=50.0),
            row(solver="null", host="there"),
        ]
    )
    assert (found.host, *set(found.rows.host), found.shortest_period_us) == ("here", "here", 125.0)
    assert (found.lanes.solve_us_p50 == 1.0).all()
    assert found.settings.set_index("tier").setting[Tier.MID] == "s1"


@pytest.mark.parametrize(
    ("scalings", "expected"),
    [
        (["scaled", "scaled", "raw"], "scaled"),
        (["raw", "raw", "scaled"], "raw"),
        (["raw", "scaled"], "scaled"),
        (["raw"], "raw"),
        ([], "scaled"),
    ],
)
def test_the_scaling_of_the_first_screen_is_the_one_with_most_measurements(scalings: list[str], expected: str) -> None:
    assert measured([row(problem=f"p{i}", scaling=scaling) for i, scaling in enumerate(scalings)]).scaling == expected


def test_warm_rows_come_with_the_setting_of_the_tier_and_are_judged_by_themselves() -> None:
    found = measured([*ladder({"p1": [1e-12]}), *ladder({"p1": [1e-8]}, start="warm")])
    high = found.rows_at_tiers[found.rows_at_tiers.tier == Tier.HIGH].set_index("start")
    assert high.right.to_dict() == {"cold": True, "warm": False}


def test_longer_calls_replace_the_hot_ones_of_their_repeat_and_interleaved_ones_beside_them_are_no_shorter() -> None:
    rows = [
        row(solve_us_p50=5.0, samples=300, timed_gap=1e-8),
        row(solve_us_p50=3.0, samples=3000, timed="long", timed_gap=1e-10),
        row(solve_us_p50=7.0, samples=10, timed="interleaved", cost_gap=1e-7),
        row(solve_us_p50=4.0, samples=300, repeat=1),
        row(solve_us_p50=9.0, samples=300, solver="osqp"),
        row(solve_us_p50=2.0, samples=10, solver="osqp", timed="interleaved"),
        row(timed="long", samples=0, status="crashed", solver="osqp", answer_us=NAN),
    ]
    found = merged(table(rows)).set_index("solver")
    assert found[["answer_us", "interleaved_us", "status"]].T.to_dict("list") == {
        "daqp": [3.5, 7.0, "answered"],
        "osqp": [9.0, 9.0, "crashed"],
    }
    assert found.loc["daqp", ["samples", "repeats", "cost_gap", "timed_gap"]].tolist() == [3300, 2, 1e-7, 1e-8]


def test_an_answer_takes_no_less_than_half_of_the_processor_time_in_every_percentile() -> None:
    key = {"timed": "hot", "repeat": 0}
    rows = table([row(samples=3, cpu_us=6.0), row(problem="p2", samples=3)])
    raw = [
        {"task": task, **key, "what": what, "ns": np.array(ns)}
        for task in rows.task
        for what, ns in (("update", [500, 500, 500]), ("solve", [500, 1000, 9500]))
    ]
    found = Measurements(rows, pd.DataFrame(raw))
    assert [found.pooled([task]).tolist() for task in rows.task] == [[4.0, 4.0, 10.0], [1.0, 1.5, 10.0]]
    assert found.pooled(rows.task, "interleaved").size == 0


def test_a_tier_that_is_not_reached_has_no_row_and_warm_starts_have_their_own() -> None:
    table = summary(measured([*ladder({"p1": [1e-8]}), *ladder({"p1": [1e-12]}, start="warm", solve_us_p50=0.5)]))
    assert set(table.tier) == {"low", "mid"}
    assert table.groupby("start").solve_us_p50.first().to_dict() == {"cold": 1.0, "warm": 0.5}


def test_a_median_of_interleaved_times_is_unknown_if_a_problem_lacks_it() -> None:
    rows = [*ladder({"p1": [0.0], "p2": [0.0]}), *ladder({"p1": [0.0]}, timed="interleaved")]
    assert summary(measured(rows)).interleaved_us.isna().all()


EPS = '{"eps": 1e-8}'
SAME = {("daqp", "qpsolvers"): (1, 8.0, 2.0, 4.0)}
"""Problems, time, time in the lane direct and their ratio, by wrapper."""


def timed_row(us: float, **known: object) -> Row:
    """A row at a setting that both lanes have."""
    return row(**{"settings": EPS, "setting": EPS, "solve_us_p50": us, **known})


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        pytest.param(
            [
                one
                for problem, direct, through in (("p1", 2.0, 20.0), ("p2", 4.0, 20.0), ("p3", 1.0, 30.0))
                for one in (timed_row(direct, problem=problem), timed_row(through, problem=problem, lane="qpsolvers"))
            ],
            {("daqp", "qpsolvers"): (3, 20.0, 2.0, 10.0)},
            id="the median of the ratios over the problems",
        ),
        pytest.param(
            [timed_row(1.0, update_us=1.0), timed_row(2.0, update_us=4.0, lane="cvxpy")],
            {("daqp", "cvxpy"): (1, 6.0, 2.0, 3.0)},
            id="update and solve count in both lanes",
        ),
        pytest.param(
            [
                timed_row(2.0),
                timed_row(8.0, lane="qpsolvers", settings='{"raise_error": false, "eps": 1e-8}'),
                timed_row(9.0, lane="cvxpy", settings='{"eps": 1e-5}'),
            ],
            SAME,
            id="at identical settings only, apart from those of error reporting",
        ),
        pytest.param(
            [
                row(is_default=True),
                row(lane="qpsolvers", is_default=True),
                row(lane="cvxpy", is_default=True, settings='{"raise_error": false}'),
            ],
            {},
            id="a default without a value, which each package interprets",
        ),
        pytest.param(
            [
                timed_row(2.0),
                timed_row(8.0, lane="qpsolvers"),
                timed_row(1.0, problem="p2"),
                timed_row(90.0, problem="p2", lane="qpsolvers", cost_gap=2e-3),
                timed_row(1.0, problem="p3", timed_gap=1.0),
                timed_row(70.0, problem="p3", lane="qpsolvers"),
                timed_row(50.0, problem="p4", lane="qpsolvers"),
            ],
            SAME,
            id="problems on which both are right to a thousandth",
        ),
        pytest.param(
            [timed_row(2.0, status="cached"), timed_row(8.0, lane="qpsolvers")], {}, id="a cheat is never right"
        ),
        pytest.param(
            [timed_row(2.0), timed_row(8.0, lane="qpsolvers", problem_set="orders")], {}, id="a namesake in another set"
        ),
        pytest.param(
            [
                timed_row(2.0),
                timed_row(8.0, lane="qpsolvers"),
                timed_row(0.1, start="warm"),
                timed_row(0.2, scaling="raw"),
                timed_row(99.0, scaling="raw", lane="qpsolvers"),
                row(problem="p2"),
            ],
            SAME,
            id="cold rows of the first scaling only",
        ),
        pytest.param(
            [timed_row(2.0, solver="highspy"), timed_row(8.0, solver="highs", lane="qpsolvers")],
            {("highs", "qpsolvers"): (1, 8.0, 2.0, 4.0)},
            id="the name that a library has in the lane direct",
        ),
        pytest.param([timed_row(2.0), timed_row(8.0, lane="kernel")], {}, id="our compiled lane is nobody's wrapper"),
    ],
)
def test_the_share_of_a_wrapper(
    rows: list[Row], expected: dict[tuple[str, str], tuple[int, float, float, float]]
) -> None:
    found = {
        (line.solver, line.lane): (line.problems, line.us, line.direct_us, line.ratio)
        for line in wrapper_share(measured(rows)).itertuples()
    }
    assert found == expected


def test_ours_is_beside_another_on_the_problems_that_both_are_right_on_however_many_those_are() -> None:
    quick = [row(solver="box_active_set", problem=f"p{i}", solve_us_p50=1.0) for i in range(3)]
    found = like_with_like(
        measured(
            [
                *quick,
                row(solver="box_active_set", problem="slow", solve_us_p50=100.0),
                row(solver="projected_difference", problem="p0", solve_us_p50=0.5),
                row(solver="daqp", problem="slow", solve_us_p50=50.0),
                row(solver="osqp", problem="p0", problem_set="orders", solve_us_p50=50.0),
            ]
        )
    )
    shown = found[["ours", "other", "problems", "ours_us", "other_us", "ratio"]].astype(object)
    assert shown.where(found.notna(), None).to_numpy().tolist() == [
        ["box_active_set", "daqp", 1, 100.0, 50.0, 2.0],
        ["box_active_set", "osqp", 0, None, None, None],
    ]
    assert [column.format(math.nan) for column in BESIDE[-1:]] == ["–"]
