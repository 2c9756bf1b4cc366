"""Simulated pairs of runs with known changes, as logarithms of times."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from solvers.arrays import Vector

TURNS = 10
OFFSET = 0.015
"""Scale of the change between two processes, in logarithms of the time."""


def noise(chance: np.random.Generator, count: int) -> Vector:
    """Logarithms of the median times of one solver on ``count`` problems: autocorrelated noise, and bursts of load by
    other processes."""
    shocks, found = 0.04 * chance.normal(size=(TURNS, count)), np.zeros((TURNS, count))
    for i in range(1, TURNS):
        found[i] = 0.7 * found[i - 1] + shocks[i]
    delays = np.where(chance.random(found.shape) < 0.05, chance.exponential(2.0, found.shape), 0.0)
    return np.asarray(np.log(np.median(np.exp(found) * (1.0 + delays), axis=0)))


def ratios(chance: np.random.Generator, lanes: int, problems: int, offset: float = OFFSET) -> list[Vector]:
    """Logarithms of the ratios of each lane without a change: every process has an offset with heavy tails, every
    problem a drift common to all lanes."""
    drift = 0.3 * chance.normal(size=problems)
    return [
        drift
        + offset * (chance.standard_t(5) - chance.standard_t(5))
        + noise(chance, problems)
        - noise(chance, problems)
        for _ in range(lanes)
    ]


def resampled(chance: np.random.Generator, own: list[Vector]) -> list[Vector]:
    """A pair with the noise ``own`` of a real one: lanes, and the problems of each, are resampled."""
    drawn = [own[i] for i in chance.integers(0, len(own), len(own))]
    return [chance.choice((-1.0, 1.0)) * chance.choice(part, part.size) for part in drawn]


def pair(by_lane: list[Vector], changed: Mapping[str, float] | None = None, timed: str = "interleaved") -> pd.DataFrame:
    """The table of a pair with solvers s0, s1, …; ``changed`` has factors of change by name."""
    return pd.DataFrame(
        [
            {
                "timed": timed,
                "digest": f"p{k}",
                "scaling": "scaled",
                "solver": f"s{i}",
                "lane": "direct",
                "level_a": 0.0,
                "level_b": value + np.log((changed or {}).get(f"s{i}", 1.0)),
            }
            for i, values in enumerate(by_lane)
            for k, value in enumerate(values)
        ]
    )
