"""The large table: warm starts, and times that some problems lack; the committed run has the rest."""

from measured_rows import ladder, measured

from bench.derived.summary import raced, summary


def test_a_tier_that_is_not_reached_has_no_row_and_warm_starts_have_their_own() -> None:
    table = summary(measured([*ladder({"p1": [1e-8]}), *ladder({"p1": [1e-12]}, start="warm", solve_us_p50=0.5)]))
    assert set(table.tier) == {"low", "mid"}
    assert table.groupby("start").solve_us_p50.first().to_dict() == {"cold": 1.0, "warm": 0.5}
    assert set(raced(table, "warm").start) == {"warm"}


def test_a_median_of_interleaved_times_is_unknown_if_a_problem_lacks_it() -> None:
    hot = ladder({"p1": [0.0], "p2": [0.0]})
    table = summary(measured([*hot, *ladder({"p1": [0.0]}, timed="interleaved")]))
    assert table.interleaved_us.isna().all()
