"""Error of an answer from its row: the largest of gap, violation and timed answers, and the rule of the stage."""

import math

import pytest
from measured_rows import row, table

from bench.derived.accuracy import TOLERANCE, error, right
from bench.messages.verdict import Status, Tier

NAN = float("nan")


def error_of(tier: Tier, **known: float | str) -> float:
    return float(error(table([row(**known)]), tier).iloc[0])


def is_right(tier: Tier, **known: float | str) -> bool:
    return bool(right(table([row(**known)]), tier).iloc[0])


@pytest.mark.parametrize("tier", TOLERANCE)
@pytest.mark.parametrize("part", ["cost_gap", "violation", "timed_gap"])
def test_the_error_is_the_largest_of_gap_violation_and_timed_gap_over_the_tolerance(tier: Tier, part: str) -> None:
    others = dict.fromkeys(("cost_gap", "violation", "timed_gap"), 0.25 * TOLERANCE[tier])
    assert error_of(tier, **others) == pytest.approx(0.25)
    assert error_of(tier, **others | {part: 3.0 * TOLERANCE[tier]}) == pytest.approx(3.0)
    assert is_right(tier, **others | {part: TOLERANCE[tier]})
    assert not is_right(tier, **others | {part: 1.01 * TOLERANCE[tier]})
    assert is_right(tier, **others | {"cost_gap": -1e-17})  # rounding


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


@pytest.mark.parametrize("status", [status for status in Status if status is not Status.OK])
def test_an_answer_whose_status_is_not_ok_has_an_infinite_error_however_small_its_gap(status: Status) -> None:
    assert (
        error_of(Tier.LOW, status=str(status)) == error_of(Tier.STAGE, status=str(status), stage_excess=0.0) == math.inf
    )
    assert not is_right(Tier.DEFAULT, status=str(status))
