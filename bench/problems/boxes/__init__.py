"""Two hundred small programs with bounds, for the tests of any solver: the same bits everywhere, and for ever.

    minimise ½ xᵀP x + qᵀx   subject to   lb ≤ x ≤ ub

Forty are from identification and are stored in ``identification.npz``. The others are drawn in integers, by the one
random sequence that Python guarantees (``random.Random.random``), and hence do not depend on a library or a processor:

- P = L D Lᵀ times a power of two, with L unit lower triangular in {−1, 0, 1} and D powers of two, so P ⪰ 0 exactly;
- q = λ − P x, where x is at a bound or between its bounds and λ has the sign that the bound requires.

Unless q has to be rounded, x is an optimum. License of the data: CC BY 4.0.
"""

import random
from collections.abc import Sequence
from functools import cache, partial
from math import log2
from pathlib import Path
from typing import ClassVar

import numpy as np
from qpsolvers import Problem

from bench.problem_files.npz import opened, unpacked_program
from bench.problem_files.program import ReadProgram
from bench.problems.foreign import ForeignPrograms, Source

DATA = Path(__file__).with_name("identification.npz")
EACH = 40
"""Number of programs of a kind."""
KINDS = {
    "conditioned": (1e2, 1e14),
    "degenerate": (1e1, 1e6),
    "semidefinite": (1e1, 1e6),
    "scaled": (1e1, 1e8),
}
"""Ratios of the largest to the smallest element of D, for the first and the last program of a kind."""
LARGEST = 60
"""Largest number of variables."""


class Boxes(ForeignPrograms):
    """Drawn and stored programs, by kind."""

    name = "boxes"
    description = "200 small programs with bounds, for a solver's own tests: ill-conditioned, degenerate, scaled"
    takes: ClassVar = {}

    def sources(self) -> Sequence[tuple[str, Source]]:
        """Name and maker of each program."""
        drawn_ones: list[tuple[str, Source]] = [
            (f"{kind}-{i:02d}", partial(_read, partial(drawn, kind, i))) for kind in KINDS for i in range(EACH)
        ]
        return drawn_ones + [(name, partial(_read, partial(_stored, name))) for name in _names()]


def _read(make: partial[Problem]) -> ReadProgram:
    return ReadProgram(make())


@cache
def _names() -> tuple[str, ...]:
    with opened(DATA) as arrays:
        return tuple(sorted({key.split("/")[0] for key in arrays}))


def _stored(name: str) -> Problem:
    with opened(DATA) as arrays:
        return unpacked_program(arrays, f"{name}/")


def drawn(kind: str, i: int) -> Problem:
    """The program ``i`` of a kind, with 1 to LARGEST variables.

    Examples
    --------
    >>> program = drawn("degenerate", 0)
    >>> program.P.tolist(), program.q.tolist(), program.lb.tolist(), program.ub.tolist()
    ([[1.0]], [4.0], [-1.0], [1.0])
    """
    chance = random.Random(f"{kind} {i}")

    def below(limit: int) -> int:
        return int(chance.random() * limit)

    d = 1 + (LARGEST - 1) * i // (EACH - 1)
    low, high = (log2(ratio) for ratio in KINDS[kind])
    most = round(low + (high - low) * i / (EACH - 1))
    exponents = [0, most, *(below(most + 1) for _ in range(d))][:d]
    D = [0 if kind == "semidefinite" and below(3) == 0 else 1 << e for e in exponents]
    L = [[below(3) - 1 if below(d) < 3 else 0 for _ in range(row)] + [1] for row in range(d)]
    P = [[sum(a * b * c for a, b, c in zip(L[r], L[c], D, strict=False)) for c in range(d)] for r in range(d)]
    lb, ub, x, multipliers = [], [], [], []
    for _ in range(d):
        at, width = below(3), 0 if kind == "degenerate" and below(8) == 0 else 1 + below(4)
        bottom = below(17) - 8
        lb.append(-np.inf if at == 1 and below(4) == 0 else bottom)
        ub.append(np.inf if at == 0 and below(4) == 0 else bottom + width)
        x.append((2 * bottom, 2 * bottom + width, 2 * (bottom + width))[at])  # in halves
        size = 0 if at == 1 or (kind == "degenerate" and below(2) == 0) else 1 + below(9)
        multipliers.append(size if at == 0 else -size)
    q = [2 * each - sum(p * t for p, t in zip(row, x, strict=True)) for row, each in zip(P, multipliers, strict=True)]
    shifts = np.array([below(41) - 20 if kind == "scaled" else 0 for _ in range(d)])
    cost = below(121) - 60 if kind == "scaled" else 0
    return Problem(
        np.ldexp(np.array(P, dtype=np.float64), shifts[:, None] + shifts + cost),
        np.ldexp(np.array(q, dtype=np.float64), shifts - 1 + cost),
        lb=np.ldexp(np.array(lb, dtype=np.float64), -shifts),
        ub=np.ldexp(np.array(ub, dtype=np.float64), -shifts),
    )
