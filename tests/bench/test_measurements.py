"""Rows of a run: one for all repeats, times of the host with most rows, the scaling of the first screen."""

import numpy as np
import pandas as pd
import pytest
from measured_rows import ladder, measured, row, table

from bench.derived.measurements import Measurements, merged
from bench.messages.verdict import Tier

NAN = float("nan")


def test_repeats_become_one_row_with_medians_spread_the_largest_and_the_sum() -> None:
    rows = table(
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
        ]
    )
    one_row = merged(rows)
    (one,) = one_row.to_dict("records")
    expected = {
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
    }
    assert {name: one[name] for name in expected} == expected
    assert one["answer_us_spread"] == pytest.approx((4.0 - 2.0) / 3.0)
    assert one_row.columns.tolist() == [*rows.columns, "repeats", "answer_us_spread", "interleaved_us"]


def test_a_failure_in_one_repeat_is_the_status_of_the_row() -> None:
    lost = row(repeat=1, status="crashed", message="SIGSEGV", cost_gap=NAN, solve_us_p50=NAN)
    later = row(repeat=2, status="missed", message="another", solve_us_p50=3.0)
    for order in ([later, lost, row(solve_us_p50=2.0)], [row(solve_us_p50=2.0), lost, later]):
        (one,) = merged(table(order)).to_dict("records")
        assert (one["status"], one["message"], one["repeats"]) == ("crashed", "SIGSEGV", 3)
        assert (one["solve_us_p50"], one["answer_us_spread"]) == (2.5, pytest.approx(0.4))


def test_a_repeat_in_which_a_setting_was_not_run_hides_no_repeat_in_which_it_was() -> None:
    skipped = row(
        status="not_run",
        message="a looser setting took longer than 0.1 s on this problem",
        cost_gap=NAN,
        solve_us_p50=NAN,
        samples=0,
    )
    for at in range(3):
        repeats = [row(solve_us_p50=2.0, samples=5), row(solve_us_p50=4.0, samples=5)]
        repeats.insert(at, skipped)
        (one,) = merged(table([{**each, "repeat": i} for i, each in enumerate(repeats)])).to_dict("records")
        assert (one["status"], one["message"], one["cost_gap"], one["repeats"], one["samples"]) == (
            "ok",
            "",
            0.0,
            2,
            10,
        )
        assert one["solve_us_p50"] == 3.0
    crashed = row(repeat=2, status="crashed", cost_gap=NAN)
    assert merged(table([row(), {**skipped, "repeat": 1}, crashed])).status.tolist() == ["crashed"]
    assert merged(table([skipped, {**skipped, "repeat": 1}])).status.tolist() == ["not_run"]


def test_times_are_those_of_the_host_with_most_rows_and_settings_are_judged_by_all() -> None:
    found = measured(
        [
            *ladder({"p1": [1e-8, 1e-12], "p2": [1e-8, 1e-12]}, host="here", solve_us_p50=1.0),
            *ladder({"p1": [1e-5, 1e-12]}, host="there", solve_us_p50=50.0),
            row(solver="null", host="there"),
        ]
    )
    assert found.host == "here"
    assert set(found.rows.host) == {"here"}
    assert (found.field.solve_us_p50 == 1.0).all()
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
    high = found.tiers[found.tiers.tier == Tier.HIGH].set_index("start")
    assert high.right.to_dict() == {"cold": True, "warm": False}


def test_longer_calls_replace_the_hot_ones_of_their_repeat_and_interleaved_ones_stand_beside_them() -> None:
    rows = [
        row(solve_us_p50=5.0, samples=300, timed_gap=1e-8),
        row(solve_us_p50=3.0, samples=3000, timed="long", timed_gap=1e-10),
        row(solve_us_p50=7.0, samples=10, timed="interleaved", cost_gap=1e-7),
        row(solve_us_p50=4.0, samples=300, repeat=1),
        row(solve_us_p50=9.0, samples=300, solver="osqp"),
        row(timed="long", samples=0, status="crashed", solver="osqp", answer_us=NAN),
    ]
    found = merged(table(rows)).set_index("solver")
    assert found.answer_us.to_dict() == {"daqp": 3.5, "osqp": 9.0}
    assert found.interleaved_us.daqp == 7.0
    assert (found.samples.daqp, found.repeats.daqp) == (3300, 2)
    assert (found.cost_gap.daqp, found.timed_gap.daqp) == (1e-7, 1e-8)
    assert found.status.to_dict() == {"daqp": "ok", "osqp": "crashed"}


def test_an_answer_takes_no_less_than_half_of_the_processor_time_in_every_percentile() -> None:
    key = {"timed": "hot", "session": 0, "repeat": 0}
    rows = table([row(samples=3, cpu_us=6.0), row(problem="p2", samples=3)])
    raw = [
        {"task": task, **key, "what": what, "ns": np.array(ns)}
        for task in rows.task
        for what, ns in (("update", [500, 500, 500]), ("solve", [500, 1000, 9500]))
    ]
    found = Measurements(rows, pd.DataFrame(raw))
    assert [found.pooled([task]).tolist() for task in rows.task] == [[4.0, 4.0, 10.0], [1.0, 1.5, 10.0]]
    assert found.pooled(rows.task, "interleaved").size == 0
