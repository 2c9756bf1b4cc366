"""An absolute schedule of samples, and the lateness of a solver's answers on it.

Sample k is due at t_k = t₀ + k T, whatever happened before. A busy solver is not interrupted; when it is done, it takes
the newest sample that is due, with the data of the samples that it has missed. For sample k and the first solve j that
includes it, begun at b_j and ended at e_j,

    service time   e_j − b_j,      response time   e_j − t_k  ≥  e_j − b_j,

and the answer is late if the response time is above T. A loop without a schedule never sees the difference of the two
(coordinated omission).

Between samples the loop sleeps while more than SPIN_NS remain, and then spins: a sleep may end some 60 µs late (slack
of the system's timers and the way back to the core), which at 8 kHz leaves no time to sleep.
"""

import math
import time
from collections.abc import Callable, Iterator

import numpy as np

from solvers.arrays import Mask, Nanoseconds

PERIOD_NS = 125_000
PERIOD_US = PERIOD_NS / 1e3
"""The paper's sampling period."""
SPIN_NS = 300_000
LEAD_NS = 2_000_000
"""Time from the call to the first due time."""


def runs(late: Mask) -> int:
    """Number of runs of consecutive true entries.

    Examples
    --------
    >>> runs(np.array([True, True, False, True]))
    2
    """
    return int(np.count_nonzero(late[1:] & ~late[:-1])) + int(late.size > 0 and late[0])


def wait_until(moment: int, clock: Callable[[], int], sleep: Callable[[float], None], spin_ns: int = SPIN_NS) -> None:
    """Sleep, then spin for the last ``spin_ns``, until the clock shows the moment, ns."""
    remaining = moment - clock() - spin_ns
    if remaining > 0:
        sleep(remaining * 1e-9)
    while clock() < moment:
        pass


def schedule(
    period_ns: int,
    samples: float = math.inf,
    clock: Callable[[], int] = time.perf_counter_ns,
    sleep: Callable[[float], None] = time.sleep,
    spin_ns: int = SPIN_NS,
) -> Iterator[tuple[int, int, int]]:
    """Wait for each sample and yield its number, its due time in ns, and how many due times were skipped before it,
    because they had passed; the last sample is not skipped."""
    start, k, skipped = clock() + LEAD_NS, 0, 0
    while k < samples:
        wait_until(start + k * period_ns, clock, sleep, spin_ns)
        yield k, start + k * period_ns, skipped
        newest = int(max(k + 1, min((clock() - start) // period_ns, samples - 1)))
        k, skipped = newest, newest - k - 1


def follow(
    samples: int,
    update: Callable[[int], None],
    solve: Callable[[], object],
    keep: Callable[[int], None],
    *,
    period_ns: int = PERIOD_NS,
    clock: Callable[[], int] = time.perf_counter_ns,
    sleep: Callable[[float], None] = time.sleep,
) -> dict[str, Nanoseconds]:
    """Run a solver on the schedule.

    Parameters
    ----------
    samples : int
        Number of samples on the schedule.
    update : callable (k)
        Pass the data of sample k to the solver.
    solve : callable
        Solve.
    keep : callable (j)
        Save the answer of solve j; not timed.
    clock, sleep : callable
        Clock in nanoseconds, and sleep in seconds.

    Returns
    -------
    dict
        ``update`` and ``solve``, the times of each of the M solves in ns, ``sample``, the newest sample of each, shape
        (M,), and ``response``, the response time of each sample in ns, shape (samples,).
    """
    solved, began, updated, ended = (np.full(samples, -1, dtype=np.int64) for _ in range(4))
    count = 0
    for k, due, _ in schedule(period_ns, samples, clock, sleep):
        begin, start = clock(), due - k * period_ns
        update(k)
        between = clock()
        solve()
        end = clock()
        solved[count], began[count], updated[count], ended[count] = k, begin - start, between - start, end - start
        keep(count)
        count += 1
    every = np.arange(samples)
    return {
        "update": (updated - began)[:count],
        "solve": (ended - updated)[:count],
        "sample": solved[:count],
        "response": ended[np.searchsorted(solved[:count], every)] - every * period_ns,
    }
