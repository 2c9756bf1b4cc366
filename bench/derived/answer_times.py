"""What answers took, call by call: update and solve together, the same in tables, plots and decisions.

A percentile of a solver is that of all its calls on all the problems in question. Hot calls follow each other; in turns
each finds the caches that the other solvers left.
"""

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Microseconds = NDArray[np.float64]
HOT, IN_TURNS = "", "interleaved_"


def by_task(times: pd.DataFrame, ways: Sequence[str] = (HOT,)) -> dict[str, list[Microseconds]]:
    """Update and solve together by task, µs; where updates were timed apart, their median is added."""
    found: dict[str, list[Microseconds]] = {}
    for way in ways:
        both = [times[times.what == f"{way}{what}"].set_index(["task", "repeat"]).ns for what in ("update", "solve")]
        for key in both[1].index:
            solve = np.asarray(both[1][key], dtype=np.float64) / 1e3
            update = np.asarray(both[0][key], dtype=np.float64) / 1e3 if key in both[0].index else np.zeros(0)
            if solve.size:
                found.setdefault(key[0], []).append(
                    solve + (update if update.size == solve.size else np.median(update) if update.size else 0.0)
                )
    return found


def pooled(found: dict[str, list[Microseconds]], tasks: Iterable[str]) -> Microseconds:
    """Those of some tasks, each counted once."""
    parts = [part for task in dict.fromkeys(tasks) for part in found.get(task, [])]
    return np.concatenate(parts) if parts else np.zeros(0)
