"""The setting of a tier: the loosest that meets it on every problem with margin ten, else three, else one."""

import numpy as np
import pandas as pd
import pytest
from measured_rows import ladder, row, table

from bench.derived.tier_settings import FEWEST, choice, left_out, margin, tier_settings
from bench.messages.task import Row
from bench.messages.verdict import Tier

NAN = float("nan")


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
    assert (found.setting, found.rung, found.margin, found.problems, found.right) == (
        setting,
        int(setting[1]),
        times,
        2,
        2,
    )
    assert found.furthest == setting


def test_without_a_setting_right_on_every_problem_a_tier_is_not_reached_and_the_furthest_is_named() -> None:
    found = settings(ladder({"p1": [1e-5, 1e-8, 1e-8], "p2": [1e-5, 1e-5, 1e-8], "p3": [1e-8, 1e-8, 1e-5]})).loc[
        Tier.MID
    ]
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
            for other in ({"repeat": 1}, {"host": "there"}, {"timed": "interleaved"}, {"session": 1})
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
    assert choice(errors) is None
    assert left_out(errors) == 0.0  # without the first s0, without the last s1, and without the middle one none
    assert margin(np.array([0.3, 0.05])) == 3.0
