"""Tiers that are lost or gained from one run to another, on tables by hand: a solver with the settings s0 and s1 on
some problems."""

import math

import numpy as np
import pandas as pd
import pytest
from measured_rows import ladder, table

from bench.comparison.compare import lost_tiers
from bench.messages.verdict import Status

PROBLEMS = [f"p{i}" for i in range(9)]
GAPS = dict.fromkeys(PROBLEMS, (1e-5, 1e-11))


def run(gaps: dict[str, tuple[float, float]] = GAPS, **known: object) -> pd.DataFrame:
    return table(ladder(gaps, **known))


def timed_wrong(rows: pd.DataFrame, problems: list[str]) -> pd.DataFrame:
    return rows.assign(timed_gap=np.where(rows.problem.isin(problems), 1.0, 0.0))


def lost(a: pd.DataFrame, b: pd.DataFrame, least: int = 1) -> list[str]:
    return lost_tiers(a, b, least).tier.tolist()


def test_a_tier_that_one_problem_no_longer_meets_by_its_first_answer_is_lost_and_the_other_way_round_gained() -> None:
    worse = run({**GAPS, "p0": (1e-5, 1e-8)})
    assert lost(run(), worse) == ["high"]
    assert lost(worse, run()) == []


def test_another_setting_that_reaches_the_tier_keeps_it() -> None:
    assert lost(run({**GAPS, "p0": (1e-11, 1e-11)}), run(dict.fromkeys(PROBLEMS, (1.0, 1e-11)))) == []


@pytest.mark.parametrize(("count", "is_lost"), [(1, False), (5, False), (6, True), (9, True)])
def test_timed_answers_lose_a_tier_where_they_are_wrong_on_more_problems_than_by_chance(
    count: int, is_lost: bool
) -> None:
    assert lost(run(), timed_wrong(run(), PROBLEMS[:count])) == (["low", "mid", "high"] if is_lost else [])


@pytest.mark.parametrize(("count", "is_lost"), [(1, False), (5, False), (6, True)])
def test_on_other_problems_first_answers_are_subject_to_chance_too(count: int, is_lost: bool) -> None:
    other = run({**GAPS, **dict.fromkeys(PROBLEMS[:count], (1e-5, 1e-8))})
    assert lost(run(), other, least=6) == (["high"] if is_lost else [])


def test_a_solver_that_crashes_loses_every_tier() -> None:
    crashed = run().assign(status=str(Status.CRASHED), cost_gap=math.nan)
    assert lost(run(), crashed) == ["low", "mid", "high"]
