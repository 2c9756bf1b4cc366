"""The setting of each solver in the second pass."""

import numpy as np
import pytest
from measured_rows import ladder, row, table

from bench.messages.task import Row
from bench.races.oneshot.second_pass import LONGEST_US, NEAR, planned

NAN = float("nan")
DEFAULTS = row(setting="d", rung=-1, is_default=True, cost_gap=0.1)


def settings(rows: list[Row]) -> dict[str, str]:
    """The setting of each solver."""
    plan = planned(table(rows), 3000)
    return dict(zip(plan.solver, plan.setting, strict=True))


@pytest.mark.parametrize(
    ("gaps", "setting"),
    [([1e-5, 1e-8, 1e-11], "s2"), ([1e-5, 1e-8, 1e-8], "s1"), ([1e-5, 1e-5, 1e-5], "d"), ([NAN, NAN, NAN], "d")],
)
def test_the_setting_is_that_for_1e_9_else_for_1e_6_else_the_solvers_defaults(gaps: list[float], setting: str) -> None:
    assert settings([*ladder({"p1": gaps}), DEFAULTS]) == {"daqp": setting}


def test_races_that_draw_other_data_for_their_timed_answers_have_the_same_setting() -> None:
    rng = np.random.default_rng(0)
    plans = [
        settings(
            ladder({"p1": [1e-10, 1e-12], "p2": [1e-11, 1e-12]}, timed_gap=[float(rng.choice([1e-11, 1e-3])), 1e-12])
        )
        for _ in range(8)
    ]
    assert plans == [{"daqp": "s0"}] * 8


def test_solvers_near_the_fastest_of_their_lane_are_timed_longer() -> None:
    rows = [
        *ladder({"p1": [1e-12]}, solve_us_p50=1.0),
        *ladder({"p1": [1e-12]}, solver="near", solve_us_p50=NEAR, timed_gap=1e-3),
        *ladder({"p1": [1e-12]}, solver="far", solve_us_p50=1.1 * NEAR),
        *ladder({"p1": [1e-12]}, solver="wrapped", lane="qpsolvers"),
    ]
    plan = planned(table(rows), 3000)
    assert set(plan.solver[plan.longer]) == {"daqp", "near"}
    enough = planned(table([{**each, "samples": 3000} for each in rows]), 3000)
    assert not enough.longer.any()


def test_a_lane_is_interleaved_on_all_problems_or_on_none() -> None:
    rows = [
        *ladder({"p1": [1e-12], "p2": [1e-12]}, solve_us_p50=LONGEST_US),
        *ladder({"p1": [1e-12]}, solver="slow_once", solve_us_p50=1.0),
        *ladder({"p2": [1e-12]}, solver="slow_once", solve_us_p50=1.1 * LONGEST_US),
        *ladder({"p1": [1e-12], "p2": [NAN]}, solver="fails_once"),
        row(setting="{}", rung=-1, is_default=True, solver="null", status="solver_failed"),
        *ladder({"p1": [1e-12]}, solver="takes_some"),
        row(problem="p2", solver="takes_some", status="unsupported"),
    ]
    plan = planned(table(rows), 3000)
    assert set(plan.solver[plan.interleaved]) == {"daqp", "null", "takes_some"}
