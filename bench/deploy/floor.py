"""How many of a solver's missed deadlines the machine explains.

A long call meets more of what takes a processor away than a short one, so the solver that does nothing is looked at in
blocks that last as long as a call of the candidate. With the candidate's median T, the deadline D, the times n_i of all
M calls of the solver that does nothing, one after the other, each less the median ñ of its own series, and blocks j of
b consecutive ones:

    b = T / median(n), rounded        K = ⌊M / b⌋ blocks
    S_j = Σ (n_i − ñ),  i in j        what happened to a block
    k = #{j : T + S_j − median(S) > D}

of K blocks would have been late although the candidate needs no more than T ≤ D. The share of late calls that the
machine explains is

    r = min(B(k, K), k / K + 0.01),   B the upper 95 % bound of Clopper and Pearson (`bench.timing.percentiles`),

and of N calls of the candidate it explains ⌈r N⌉. The second term is for few blocks, whose bound says how little was
seen and not what the machine does: what nobody has seen excuses one call in a hundred at most. Where T > D the solver
is late by itself, and nothing is explained.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.derived.measurements import Microseconds
from bench.timing.percentiles import rate_bound

UNSEEN = 0.01
"""Share of calls that is explained at most by what was not seen."""
SHORTEST_US = 1e-3


@dataclass(frozen=True)
class Floor:
    """What the solver that does nothing took, call by call, in series of calls that followed each other, µs."""

    series: Sequence[Microseconds]

    @property
    def calls(self) -> Microseconds:
        """All of them."""
        return np.concatenate([np.zeros(0), *self.series])

    def explained(self, calls: Microseconds, deadline_us: float) -> int:
        """How many late ones of a candidate's calls (N,) the machine explains at most; none where the floor was not
        measured."""
        if not calls.size or not self.calls.size or (T := float(np.median(calls))) > deadline_us:
            return 0
        n = self.calls
        excess = np.concatenate([one - np.median(one) for one in self.series if one.size])
        b = min(n.size, max(1, round(T / max(float(np.median(n)), SHORTEST_US))))
        K = n.size // b
        S = excess[: K * b].reshape(K, b).sum(axis=1)
        k = int(np.count_nonzero(T + S - np.median(S) > deadline_us))
        return math.ceil(min(rate_bound(k, K), k / K + UNSEEN) * calls.size)
