"""Which tiers are reached in one of two runs only, on tables by hand."""

import numpy as np
import pandas as pd
import pytest
from measured_rows import ladder, table

from bench.comparison.tiers import GAINED, LOST, OTHER, compare_tiers, notes, sentences
from bench.derived.measurements import over_repeats
from solvers import Status

PROBLEMS = [f"p{i}" for i in range(9)]
GAPS = dict.fromkeys(PROBLEMS, (1e-5, 1e-11))
"""A solver with a setting for `low` and one for `high`, on nine problems."""


def run(gaps: dict[str, tuple[float, ...]] = GAPS, **known: object) -> pd.DataFrame:
    return over_repeats(table(ladder(gaps, **known)))


def timed_wrong(rows: pd.DataFrame, problems: list[str]) -> pd.DataFrame:
    """The table with a timed answer of every setting that is far off on some problems."""
    return rows.assign(timed_gap=rows.timed_gap.mask(rows.problem.isin(problems), 1.0))


def changes(a: pd.DataFrame, b: pd.DataFrame) -> dict[str, tuple[str, bool]]:
    """Change and whether it is by chance, by tier; those without a change are left out."""
    found = compare_tiers(a, b)
    found = found[found.change != ""]
    return {tier: (change, by_chance) for tier, change, by_chance in zip(found.tier, found.change, found.by_chance, strict=True)}


def test_a_run_reaches_what_it_reaches() -> None:
    found = compare_tiers(run(), run())
    assert dict(zip(found.tier, found.setting_b, strict=True)) == {"low": "s0", "mid": "s1", "high": "s1"}
    assert (changes(run(), run()), sentences(found), notes(found)) == ({}, [], [])


def test_a_first_answer_that_is_worse_loses_the_tiers_that_it_was_needed_for_and_the_other_way_round_gains_them() -> None:
    worse = run({**GAPS, "p0": (1e-5, 1e-8)})
    assert changes(run(), worse) == {"high": (LOST, False)}
    assert changes(worse, run()) == {"high": (GAINED, False)}
    assert sentences(compare_tiers(run(), worse)) == ["daqp (direct) no longer reaches 1e-9 on scaled data."]
    assert sentences(compare_tiers(worse, run())) == ["daqp (direct) now reaches 1e-9 on scaled data."]


def test_timed_answers_that_are_wrong_on_one_problem_lose_a_tier_by_chance_however_many_settings_and_tiers_that_is() -> None:
    drawn = timed_wrong(run(), ["p0"])
    every = {"low": (LOST, True), "mid": (LOST, True), "high": (LOST, True)}
    assert changes(run(), drawn) == every
    found = compare_tiers(run(), drawn)
    assert sentences(found) == []
    assert notes(found)[0].startswith("Tiers that are reached in one of the runs only, by chance as far as can be told: 3.")


@pytest.mark.parametrize(("count", "by_chance"), [(5, True), (6, False), (9, False)])
def test_timed_answers_that_are_wrong_on_more_problems_than_by_chance_lose_a_tier_in_earnest(count: int, by_chance: bool) -> None:
    drawn = timed_wrong(run(), PROBLEMS[:count])
    assert {chance for _, chance in changes(run(), drawn).values()} == {by_chance}


def test_timed_answers_that_became_right_as_often_as_wrong_lose_a_tier_by_chance() -> None:
    some, warm = PROBLEMS[:6], run(start="warm")
    first, second = pd.concat([run(), timed_wrong(warm, some)]), pd.concat([timed_wrong(run(), some), warm])
    assert set(changes(first, second).values()) == {(LOST, True)}
    assert set(changes(first, timed_wrong(first, some)).values()) == {(LOST, False)}


@pytest.mark.parametrize(("status", "by_chance"), [(Status.OK, True), (Status.CRASHED, False)])
def test_a_setting_that_was_not_run_loses_a_tier_by_chance_after_a_slow_answer_and_in_earnest_after_a_crash(
        status: Status, by_chance: bool) -> None:
    ended = run()
    ended.loc[(ended.problem == "p0") & (ended.setting == "s0"), "status"] = str(status)
    ended.loc[(ended.problem == "p0") & (ended.setting == "s1"), ["status", "cost_gap"]] = [str(Status.NOT_RUN), np.nan]
    assert changes(run(), ended)["high"] == (LOST, by_chance)


def test_another_setting_that_stands_for_a_tier_is_a_note() -> None:
    looser = run(dict.fromkeys(PROBLEMS, (1e-11, 1e-11)))
    found = compare_tiers(run(), looser)
    assert changes(run(), looser) == {"mid": (OTHER, False), "high": (OTHER, False)}
    assert sentences(found) == []
    assert notes(found) == ["In 2 of 3 tiers of solver lanes another setting is the loosest that does; times are compared at equal settings."]


def test_problems_and_solver_lanes_of_one_run_alone_decide_nothing() -> None:
    more = pd.concat([run({**GAPS, "p9": (1.0, 1.0)}), run(solver="osqp")])
    assert changes(run(), more) == changes(more, run()) == {}
    assert compare_tiers(run(), run({"other": (1e-5, 1e-11)})).empty


def test_many_solver_lanes_that_lose_tiers_have_one_sentence() -> None:
    a, b = (pd.concat([run(gaps, solver=f"solver_{i}") for i in range(8)]) for gaps in (GAPS, {**GAPS, "p0": (1.0, 1.0)}))
    (sentence,) = sentences(compare_tiers(a, b))
    assert sentence.startswith("8 solver lanes no longer reach 24 tiers, among them: solver_0 (direct) no longer reaches 1e-3, 1e-6 and 1e-9 on")
