"""The schedule, on a simulated clock; percentiles and rates against their definitions."""

from collections.abc import Callable
from fractions import Fraction
from math import ceil, comb

import numpy as np
import pytest

from bench.timing.percentiles import QUANTILES, needed, percentile, rate_bound
from bench.timing.schedule import LEAD_NS, PERIOD_NS, SPIN_NS, follow, runs


class Clock:
    """A clock that advances by a tick when it is read, and by the time of sleep and work."""

    def __init__(self) -> None:
        self.now, self.slept = 0, 0

    def __call__(self) -> int:
        self.now += 50  # duration of one reading of the clock, ns
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)
        self.slept += 1


def run_on(clock: Clock, samples: int, service: Callable[[int], int], **options: object) -> tuple[dict, list[int]]:
    """Times of solves that take ``service(j)`` ns, and the samples of the updates."""
    updated: list[int] = []

    def solve() -> None:
        clock.now += service(len(updated) - 1)

    return follow(samples, updated.append, solve, lambda j: None, clock=clock, sleep=clock.sleep, **options), updated


def test_a_slow_solver_takes_the_newest_sample_and_is_late_at_all() -> None:
    times, updated = run_on(Clock(), 100, lambda j: 1_000_000)
    assert updated == times["sample"].tolist()
    assert set(np.diff(times["sample"])[:-1].tolist()) == {8}  # a millisecond is eight periods
    assert (times["response"] > PERIOD_NS).tolist() == [True] * 100


def test_times_on_the_schedule_are_those_of_their_definitions() -> None:
    chance = np.random.default_rng(2)
    times = np.where(chance.random(300) < 0.1, chance.integers(0, 2_000_000, 300), chance.integers(0, 150_000, 300))
    found, _ = run_on(Clock(), 300, lambda j: int(times[j]))
    response, solved = found["response"], found["sample"]
    for k in range(300):
        j = next(j for j, sample in enumerate(solved) if sample >= k)
        assert response[k] == response[solved[j]] + (solved[j] - k) * PERIOD_NS
        assert response[k] >= found["update"][j] + found["solve"][j] > times[j]
    assert runs(response > PERIOD_NS) > 1


@pytest.mark.parametrize(
    ("period_ns", "slept"),
    [pytest.param(PERIOD_NS, 1, id="before the first due time"), pytest.param(1_000_000, 20, id="before each")],
)
def test_the_loop_sleeps_only_if_more_than_the_spin_remains(period_ns: int, slept: int) -> None:
    assert LEAD_NS > SPIN_NS > PERIOD_NS
    clock = Clock()
    run_on(clock, 20, lambda j: 1_000, period_ns=period_ns)
    assert clock.slept == slept


@pytest.mark.parametrize(
    ("late", "count"), [([], 0), ([0], 0), ([1], 1), ([1, 1, 0, 1], 2), ([0, 1, 1, 0, 0, 1, 0], 2)]
)
def test_stalls_are_runs_of_late_samples(late: list[int], count: int) -> None:
    assert runs(np.array(late, dtype=bool)) == count


def below(k: int, samples: int, q: Fraction) -> Fraction:
    """P(K ≤ k) of a binomial K, term by term."""
    return sum((comb(samples, i) * q**i * (1 - q) ** (samples - i) for i in range(k + 1)), Fraction(0))


@pytest.mark.parametrize("q", [0.1, 0.5, 0.75, 0.9, 0.99, 0.999, 0.9999])
def test_a_sample_whose_range_covers_the_percentile_is_enough_and_one_value_less_is_refused(q: float) -> None:
    N = needed(q)
    assert q**N + (1 - q) ** N <= 0.05 < q ** (N - 1) + (1 - q) ** (N - 1)
    assert np.isfinite([percentile(np.arange(n), q) for n in (N - 1, N)]).tolist() == [False, True]


@pytest.mark.parametrize("q", [0.0, 1.0, -0.1, 99.9])
def test_a_percentile_is_a_share_between_zero_and_one(q: float) -> None:
    with pytest.raises(ValueError, match="must be between 0 and 1"):
        needed(q)


@pytest.mark.parametrize("q", QUANTILES[:3])
@pytest.mark.parametrize("extra", [0, 1, 17, 4001])
def test_a_percentile_is_the_observed_order_statistic(q: float, extra: int) -> None:
    sample = np.random.default_rng(extra).permutation(np.random.default_rng(1).lognormal(size=needed(q) + extra))
    assert percentile(sample, q) == np.sort(sample)[ceil(Fraction(str(q)) * sample.size) - 1]


@pytest.mark.parametrize(("events", "samples"), [(0, 30), (1, 30), (7, 50), (29, 30)])
def test_at_the_bound_of_a_rate_the_probability_of_so_few_events_is_five_per_cent(events: int, samples: int) -> None:
    assert float(below(events, samples, Fraction(rate_bound(events, samples)))) == pytest.approx(0.05, rel=1e-9)


def test_the_bound_of_a_rate_is_one_where_it_always_happened() -> None:
    assert rate_bound(5, 5) == 1.0
