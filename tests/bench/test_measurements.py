"""Rows of a run: one for all repeats, times of the host with most rows, the scaling of the first screen."""

import pytest
from measured_rows import ladder, measured, row, table

from bench.derived.measurements import over_repeats
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
    merged = over_repeats(rows)
    (one,) = merged.to_dict("records")
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
    assert one["solve_us_spread"] == pytest.approx((4.0 - 2.0) / 3.0)
    assert merged.columns.tolist() == [*rows.columns, "repeats", "solve_us_spread"]


def test_a_failure_in_one_repeat_is_the_status_of_the_row() -> None:
    lost = row(repeat=1, status="crashed", message="SIGSEGV", cost_gap=NAN, solve_us_p50=NAN)
    later = row(repeat=2, status="missed", message="another", solve_us_p50=3.0)
    for order in ([later, lost, row(solve_us_p50=2.0)], [row(solve_us_p50=2.0), lost, later]):
        (one,) = over_repeats(table(order)).to_dict("records")
        assert (one["status"], one["message"], one["repeats"]) == ("crashed", "SIGSEGV", 3)
        assert (one["solve_us_p50"], one["solve_us_spread"]) == (2.5, pytest.approx(0.4))


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
        (one,) = over_repeats(table([{**each, "repeat": i} for i, each in enumerate(repeats)])).to_dict("records")
        assert (one["status"], one["message"], one["cost_gap"], one["repeats"], one["samples"]) == (
            "ok",
            "",
            0.0,
            2,
            10,
        )
        assert one["solve_us_p50"] == 3.0
    crashed = row(repeat=2, status="crashed", cost_gap=NAN)
    assert over_repeats(table([row(), {**skipped, "repeat": 1}, crashed])).status.tolist() == ["crashed"]
    assert over_repeats(table([skipped, {**skipped, "repeat": 1}])).status.tolist() == ["not_run"]


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
