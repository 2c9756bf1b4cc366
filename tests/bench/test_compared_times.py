"""Comparison of times on simulated tables with known changes."""

import numpy as np
import pandas as pd
import pytest
from simulated_pairs import pair, ratios

from bench.comparison.compare import CANNOT_TELL, FASTER, SAME, SLOWER, compare_times

PAIRS = 15


def times(by_lane: list[np.ndarray], smallest: float = 1.2, **changed: float) -> pd.DataFrame:
    return compare_times(pair(by_lane, changed), smallest)[0].set_index("solver")


def quiet(lanes: int = 8, problems: int = 6, offset: float = 0.01) -> list[np.ndarray]:
    """Lanes evenly spread from −offset to offset, on problems that the machine meets at different speeds."""
    return [np.full(problems, own) + 0.3 * np.arange(problems) for own in np.linspace(-offset, offset, lanes)]


def test_two_runs_of_the_same_solvers_hardly_ever_differ() -> None:
    chance = np.random.default_rng(0)
    findings = [set(times(ratios(chance, 40, 18)).finding) for _ in range(PAIRS)]
    assert sum(bool(found & {SLOWER, FASTER}) for found in findings) <= 1


@pytest.mark.parametrize(("factor", "finding"), [(1.2, SLOWER), (1 / 1.2, FASTER)])
def test_a_relevant_change_is_found_on_a_quiet_machine_and_otherwise_cannot_be_told(
    factor: float, finding: str
) -> None:
    chance = np.random.default_rng(0)
    found = [times(ratios(chance, 40, 18, offset=0.008), s3=factor).finding["s3"] for _ in range(PAIRS)]
    assert found.count(finding) >= 0.8 * PAIRS
    assert SAME not in found


def test_the_common_change_on_a_problem_is_divided_out_and_changes_of_either_sign_have_their_ratios() -> None:
    found, field = compare_times(pair(quiet(), {"s5": 1.5, "s2": 0.6}), 1.2)
    found = found.set_index("solver")
    changed = {"s2": FASTER, "s5": SLOWER}
    assert found.finding.to_dict() == {f"s{i}": SAME for i in range(8)} | changed
    assert found.ratio[[*changed]].tolist() == pytest.approx([0.6, 1.5], rel=0.02)
    assert field.factor["interleaved"] == pytest.approx(np.exp(0.75), rel=0.02)


def test_intervals_are_wider_by_five_normalised_median_absolute_deviations_of_the_lanes() -> None:
    lanes = quiet()
    found, field = compare_times(pair(lanes, {"s4": 1.08}), 1.2)
    middle = np.log(found.ratio)
    assert field.deviation["interleaved"] == pytest.approx(
        1.4826 * np.median(np.abs(middle - np.median(middle))), rel=1e-4
    )
    for end in (found.ratio / found.ratio_low, found.ratio_high / found.ratio):
        assert np.log(end).to_numpy() == pytest.approx(5.0 * field.deviation["interleaved"])


def test_an_interval_that_holds_one_and_the_smallest_ratio_that_matters_cannot_tell() -> None:
    lanes = quiet()
    lanes[0] = lanes[0] + np.linspace(-0.3, 0.3, 6)
    assert times(lanes).finding.to_dict() == {"s0": CANNOT_TELL, **{f"s{i}": SAME for i in range(1, 8)}}
    assert times(lanes, smallest=2.0).finding["s0"] == SAME


@pytest.mark.parametrize(("offset", "finding"), [(0.02, SAME), (0.06, CANNOT_TELL)])
def test_a_field_that_deviates_by_more_than_three_per_cent_cannot_tell_of_any_lane(offset: float, finding: str) -> None:
    found, field = compare_times(pair(quiet(9, offset=offset)), 1.2)
    assert (field.deviation["interleaved"] > 0.03) == (finding == CANNOT_TELL)
    assert finding in set(found.finding)
    assert (finding == SAME) or set(found.finding) == {CANNOT_TELL}


@pytest.mark.parametrize("shape", [(2, 6), (8, 2)])
def test_fewer_than_three_lanes_or_problems_cannot_tell(shape: tuple[int, int]) -> None:
    found = times(quiet(*shape), s0=3.0)
    assert set(found.finding) == {CANNOT_TELL}
    assert np.isinf(found.ratio_high).all()


def test_of_three_lanes_the_one_that_takes_half_as_long_again_is_found_and_nothing_is_said_of_the_others() -> None:
    assert times(quiet(3), s1=1.5).finding.to_dict() == {"s0": CANNOT_TELL, "s1": SLOWER, "s2": CANNOT_TELL}
    assert set(times(quiet(3)).finding) == {CANNOT_TELL}


@pytest.mark.parametrize(("offset", "used", "other"), [(0.005, "hot", "interleaved"), (0.02, "interleaved", "hot")])
def test_the_times_on_which_lanes_deviate_less_are_used_unless_there_are_too_few(
    offset: float, used: str, other: str
) -> None:
    both = pd.concat([pair(quiet(offset=offset), {}, "hot"), pair(quiet())])
    lacking = both[(both.timed == other) | (both.solver != "s1") | (both.problem == "p0")]
    found = compare_times(lacking, 1.2)[0].set_index("solver")
    assert found.timed.to_dict() == {f"s{i}": other if i == 1 else used for i in range(8)}
    assert set(found.finding) == {SAME}


def test_runs_without_any_times_in_common_have_no_lanes() -> None:
    found, field = compare_times(pair(quiet())[:0].astype({"level_a": float, "level_b": float}), 1.2)
    assert (len(found), len(field)) == (0, 0)
