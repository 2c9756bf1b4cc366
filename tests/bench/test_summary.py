"""The large table: every figure of a solver lane at a tier, the floor, what went wrong."""

import numpy as np
import pytest
from measured_rows import ladder, measured, row

from bench.derived.summary import failures, raced, summary

NAN = float("nan")


def test_a_row_has_the_worst_gap_and_the_medians_over_the_problems_of_a_set() -> None:
    rows = [
        *ladder({"p1": [1e-12]}, setup_us=1.0, update_us=1.0, solve_us_p50=2.0, solve_us_max=9.0),
        *ladder({"p2": [5e-11]}, setup_us=3.0, update_us=3.0, solve_us_p50=8.0, solve_us_max=99.0),
        *ladder({"p3": [1e-13]}, setup_us=2.0, update_us=2.0, solve_us_p50=4.0, solve_us_max=7.0),
        *ladder({"p1": [1e-14]}, problem_set="orders", solve_us_p50=70.0),
    ]
    table = summary(measured(rows))
    line = table[(table.problem_set == "paper") & (table.tier == "high")].iloc[0]
    assert (line.problems, line.right, line.all_right, line.status, line.setting) == (3, 3, True, "ok", "s0")
    assert (line.worst_cost_gap, line.median_cost_gap, line.solve_us_max) == (5e-11, 1e-12, 99.0)
    assert (line.setup_us, line.update_us, line.solve_us_p50, line.total_us) == (2.0, 2.0, 4.0, 6.0)
    assert (line.margin, line.left_out) == (10.0, 1.0)  # of all sets together
    assert not line.ours
    assert table[table.problem_set == "orders"].tier.tolist().count("high") == 1


def test_right_answers_come_first_the_fastest_of_them_first_and_the_floor_last_in_each_scaling() -> None:
    rows = [
        row(solver=name, solve_us_p50=us, scaling=scaling, is_default=True, cost_gap=gap)
        for scaling in ("raw", "scaled")
        for name, us, gap in (("a", 3.0, 0.0), ("b", 1.0, 0.5), ("c", 2.0, 0.0))
    ]
    rows += [
        row(solver="null", scaling=scaling, status="solver_failed", is_default=True, solve_us_p50=0.1)
        for scaling in ("raw", "scaled")
    ]
    table = summary(measured(rows))
    for _, part in table[table.tier == "default"].groupby("scaling"):
        assert part.solver.tolist() == ["c", "a", "b", "floor"]
        assert part.status.tolist() == ["ok", "ok", "missed", "floor"]
        assert part.right.tolist() == [1, 1, 0, 0]
    assert "floor" not in set(raced(table).solver)


def test_a_tier_that_is_not_reached_has_no_row_and_warm_starts_have_their_own() -> None:
    table = summary(measured([*ladder({"p1": [1e-8]}), *ladder({"p1": [1e-12]}, start="warm", solve_us_p50=0.5)]))
    assert set(table.tier) == {"low", "mid"}
    assert table.groupby("start").solve_us_p50.first().to_dict() == {"cold": 1.0, "warm": 0.5}
    assert set(raced(table, "warm").start) == {"warm"}


def test_a_median_of_turns_is_unknown_where_any_problem_has_none() -> None:
    table = summary(measured([*ladder({"p1": [0.0]}, interleaved_us_p50=3.0), *ladder({"p2": [0.0]})]))
    assert table.interleaved_us_p50.isna().all()


def test_a_tail_is_that_of_all_calls_on_all_problems_update_and_solve_together() -> None:
    rows = [row(task="t1"), row(task="t2", problem="p2")]
    calls = np.arange(1, 201)
    times = [
        {"task": task, "repeat": 0, "what": what, "ns": ns}
        for task in ("t1", "t2")
        for what, ns in (("update", 1000 * calls), ("solve", calls))
    ]
    table = summary(measured(rows, times))
    assert table.answer_us_p99.iloc[0] == pytest.approx(
        np.quantile(np.tile(1.001 * calls, 2), 0.99, method="higher"), rel=0.01
    )
    assert summary(measured(rows[:1], times[:2])).answer_us_p99.isna().all()  # 200 calls cannot support it


def test_statuses_of_several_problems_are_counted_and_the_first_message_is_kept() -> None:
    rows = [
        row(is_default=True),
        row(problem="p2", is_default=True, status="timed_out", message="stopped", cost_gap=NAN),
        row(problem="p3", is_default=True),
    ]
    line = summary(measured(rows)).set_index("tier").loc["default"]
    assert (line.status, line.message, line.right, line.problems) == ("2 ok, 1 timed_out", "stopped", 2, 3)
    assert np.isnan(line.worst_cost_gap)


def test_what_went_wrong_is_listed_once_a_solver_lane_scaling_and_status_and_what_was_not_run_is_no_failure() -> None:
    rows = ladder({"p1": [1e-9, NAN, NAN], "p2": [1e-9, NAN, 1e-9]}, settings=["{}", '{"eps": 1e-8}', '{"eps": 1e-9}'])
    for i, status in ((1, "crashed"), (2, "not_run"), (4, "crashed")):
        rows[i] |= {"status": status, "message": f"ended {i}"}
    assert failures(measured(rows)) == [
        ["daqp", "direct", "scaled", "crashed", "2", "eps 1e-08", "paper/p1", "ended 1"]
    ]
