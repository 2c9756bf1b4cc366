"""Number of a solver's missed deadlines that the machine explains.

A long call is more likely to be interrupted than a short one, so the calls of the solver that does nothing (null) are
grouped into blocks as long as a call of the candidate. Let T be the candidate's median time, D the deadline, n_i the
times of the M null calls in order, ñ the median of the series of call i, and j a block of b consecutive calls:

    b = T / median(n), rounded        K = ⌊M / b⌋ blocks
    S_j = Σ (n_i − ñ),  i in j        delay of a block
    k = #{j : T + S_j − median(S) > D}

k of K blocks would have been late although the candidate itself needs only T ≤ D. The share of late calls that the
machine explains is

    r = min(B(k, K), k / K + 0.01),   B the upper 95 % bound of Clopper and Pearson (`bench.timing.percentiles`),

and of N calls of the candidate it explains at most ⌈r N⌉, and at least ⌊(1 − B(K − k, K)) N⌋. The second term matters
if K is small and the bound reflects the sample size rather than the machine: delays that were not observed explain at
most one call in a hundred. If T > D, the solver is late by itself, and nothing is explained.
"""

import math
from collections.abc import Sequence

import numpy as np

from bench.derived.measurements import Microseconds
from bench.timing.percentiles import rate_bound

UNSEEN = 0.01
"""Largest share of calls that unobserved delays may explain."""
SHORTEST_US = 1e-3


def explained(series: Sequence[Microseconds], calls: Microseconds, deadline_us: float) -> tuple[int, int]:
    """Fewest and most late calls of a candidate, of times (N,), that the machine explains; 0 if the solver that does
    nothing, whose times come in series of consecutive calls, was not measured."""
    n = np.concatenate([np.zeros(0), *series])
    if not calls.size or not n.size or (T := float(np.median(calls))) > deadline_us:
        return 0, 0
    excess = np.concatenate([one - np.median(one) for one in series if one.size])
    b = min(n.size, max(1, round(T / max(float(np.median(n)), SHORTEST_US))))
    K = n.size // b
    S = excess[: K * b].reshape(K, b).sum(axis=1)
    k = int(np.count_nonzero(T + S - np.median(S) > deadline_us))
    most = math.ceil(min(rate_bound(k, K), k / K + UNSEEN) * calls.size)
    return math.floor((1.0 - rate_bound(K - k, K)) * calls.size), most
