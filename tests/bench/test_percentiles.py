"""Percentiles and their intervals against their definitions, by exhaustive sums."""

from fractions import Fraction
from math import ceil, comb

import numpy as np
import pytest

from bench.timing.percentiles import QUANTILES, needed, percentile, ranks, rate_bound


def below(k: int, samples: int, q: Fraction) -> Fraction:
    """P(K ≤ k) of a binomial K, term by term."""
    return sum((comb(samples, i) * q**i * (1 - q) ** (samples - i) for i in range(k + 1)), Fraction(0))


@pytest.mark.parametrize("q", [0.1, 0.5, 0.75, 0.9, 0.99, 0.999, 0.9999])
def test_a_sample_whose_range_covers_the_percentile_is_enough_and_one_value_less_is_refused(q: float) -> None:
    N = needed(q)
    assert q**N + (1 - q) ** N <= 0.05 < q ** (N - 1) + (1 - q) ** (N - 1)
    refused, given = percentile(np.arange(N - 1), q), percentile(np.arange(N), q)
    assert (refused.value, refused.low, refused.high, refused.reason) == (
        None,
        None,
        None,
        f"needs {N} samples and has {N - 1}",
    )
    assert given.value is not None
    assert given.reason == ""


@pytest.mark.parametrize("q", [0.0, 1.0, -0.1, 99.9])
def test_a_percentile_is_a_share_between_zero_and_one(q: float) -> None:
    with pytest.raises(ValueError, match="between 0 and 1 as a share"):
        needed(q)


@pytest.mark.parametrize("q", [Fraction(1, 10), Fraction(1, 2), Fraction(7, 10), Fraction(9, 10), Fraction(19, 20)])
def test_the_interval_is_the_tightest_that_covers_by_exhaustive_sums(q: Fraction) -> None:
    for N in range(needed(float(q)), needed(float(q)) + 40):
        low, high = ranks(N, float(q))
        assert 1 <= low < high <= N
        tail_below, tail_above = below(low - 1, N, q), 1 - below(high - 1, N, q)
        assert tail_below + tail_above <= Fraction(1, 20) + Fraction(1, 10**12)
        half = Fraction(1, 40)
        # Neither end can move inwards: its tail would be more than its share, which is one half where the other allows
        # it.
        share_above = max(half, q**N)
        share_below = max(half, (1 - q) ** N) if share_above == half else Fraction(1, 20) - share_above
        share_above = share_above if share_below <= half else Fraction(1, 20) - share_below
        assert below(low, N, q) > share_below
        assert 1 - below(high - 2, N, q) > share_above


@pytest.mark.parametrize("q", QUANTILES[:3])
@pytest.mark.parametrize("extra", [0, 1, 17, 4001])
def test_the_value_is_the_observed_order_statistic_and_lies_in_its_interval(q: float, extra: int) -> None:
    sample = np.random.default_rng(extra).permutation(np.random.default_rng(1).lognormal(size=needed(q) + extra))
    found = percentile(sample, q)
    rank = ceil(Fraction(str(q)) * sample.size)
    assert found.value == np.sort(sample)[rank - 1] == np.quantile(sample, q, method="inverted_cdf")
    assert found.low is not None
    assert found.high is not None
    assert found.low <= found.value <= found.high
    assert {found.low, found.high} <= set(sample.tolist())


@pytest.mark.parametrize(("events", "samples"), [(0, 30), (1, 30), (7, 50), (29, 30)])
def test_at_the_bound_of_a_rate_the_probability_of_so_few_events_is_five_per_cent(events: int, samples: int) -> None:
    bound = rate_bound(events, samples)
    likely = below(events, samples, Fraction(bound))
    assert float(likely) == pytest.approx(0.05, rel=1e-9)


def test_the_bound_of_a_rate_is_one_where_it_always_happened() -> None:
    assert rate_bound(5, 5) == 1.0
