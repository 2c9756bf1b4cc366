"""Two runs row by row: ``python -m bench.comparison.matched RUN_A RUN_B [--noise AA_1 AA_2]``.

For each task that both runs have times of, these are compared, and what differs beyond the noise of two runs of the same is
told, after correction for so many rows; see `paired` for the method. By default the times of interleaved turns are taken:
their rounds spread over seconds, so that a burst of a neighbour hits all solvers alike, and the order in a round is the same
in both runs. A hot block takes milliseconds and may fall into a burst as a whole. What all solvers share that were measured
together, on one problem in one scaling, is called the machine's where at least MANY rows of WITNESSES solvers are compared:
the median of the medians of each solver, so that one of many rows does not pass for the machine.

Two runs of the same field on the same machine (A/A) show what the method itself calls different: at most one row in twenty.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bench.comparison.paired import Effect, Vector, benjamini_hochberg, effect, holm, log_ratios, noise_band, p_values
from bench.races.oneshot.rows import ONESHOT
from bench.report.console import console, print_table
from bench.store import Run, RunError
from bench.timing.clock import Effort

NAMES = ["problem_set", "problem", "scaling", "solver", "lane", "tier", "start", "settings"]
CORRECTIONS = {"holm": holm, "bh": benjamini_hochberg}
TOGETHER = NAMES[:3]
LEVEL = 0.05
FEWEST = Effort().fewest
"""Pairs that a row needs: what the slowest solver is timed at the least; few pairs count by their few degrees of freedom."""
MANY, WITNESSES = 8, 3


@dataclass(frozen=True)
class Comparison:
    """What came out.

    Attributes
    ----------
    table : DataFrame
        One row a task: names, ``ratio`` (b over a), ``log_ratio``, ``deviation``, ``pairs``, ``freedom``, ``p``,
        ``adjusted``, ``significant``.
    noise : float
        Noise band τ.
    shared : Series
        By problem and scaling, the logarithm of what all of its rows share.
    """

    table: pd.DataFrame
    noise: float
    shared: pd.Series

    @property
    def share(self) -> float:
        """Share of the rows that differ."""
        return float(self.table.significant.mean()) if len(self.table) else 0.0


def effects_of(a: Run, b: Run, what: str = "interleaved_solve", seed: int = 0) -> pd.DataFrame:
    """Names and effect of every task that both runs have times of."""
    rows, samples = a.rows(ONESHOT).set_index("task"), [_samples(run, what) for run in (a, b)]
    generator, found = np.random.default_rng(seed), []
    for task in sorted(samples[0].keys() & samples[1].keys()):
        first, second = (each[task] for each in samples)
        pairs = [log_ratios(first[repeat], second[repeat]) for repeat in sorted(first.keys() & second.keys())]
        pairs = [ratios for ratios in pairs if ratios.size >= FEWEST]
        if pairs:
            found.append({**rows.loc[task, NAMES].to_dict(), "task": task, "effect": effect(pairs, generator)})
    if not found:
        raise RunError(f"{a.path} and {b.path}: no task has {FEWEST} times of {what!r} in both runs")
    return pd.DataFrame(found, columns=[*NAMES, "task", "effect"])


def _samples(run: Run, what: str) -> dict[str, dict[int, Vector]]:
    """Raw times by task and repeat."""
    times = run.times()
    times = times[times.what == what]
    samples: dict[str, dict[int, Vector]] = {}
    for task, repeat, ns in zip(times.task, times.repeat, times.ns, strict=True):
        samples.setdefault(task, {})[repeat] = np.asarray(ns, dtype=np.float64)
    return samples


def compare(effects: pd.DataFrame, noise: float | None = None, correction: str = "bh", level: float = LEVEL) -> Comparison:
    """Which effects are beyond the noise; without a noise band from an A/A pair it is that of the rows themselves."""
    each: list[Effect] = list(effects.effect)
    log_ratio = pd.Series([one.log_ratio for one in each], index=effects.index, dtype=float)
    shared = _shared(effects, log_ratio)
    own = log_ratio - shared
    band = noise_band(each, shared) if noise is None else noise
    p = p_values(each, band, shared)
    adjusted = CORRECTIONS[correction](p)
    table = effects.drop(columns="effect").assign(
        ratio=np.exp(log_ratio), own_ratio=np.exp(own), log_ratio=log_ratio, deviation=[one.deviation for one in each],
        pairs=[one.pairs for one in each], freedom=[one.freedom for one in each], p=p, adjusted=adjusted, significant=adjusted < level)
    of_units = shared.groupby([effects[name] for name in TOGETHER]).first()
    return Comparison(table.sort_values("p", ignore_index=True), band, of_units)


def noise_of(effects: pd.DataFrame) -> float:
    """The noise band of two runs of the same."""
    log_ratio = pd.Series([one.log_ratio for one in effects.effect], index=effects.index, dtype=float)
    return noise_band(list(effects.effect), _shared(effects, log_ratio))


def _shared(effects: pd.DataFrame, log_ratio: pd.Series) -> pd.Series:
    """What the rows share that were measured together, or all rows where those are few; nothing where all are few."""
    def of(part: pd.Series, otherwise: float) -> float:
        by_solver = part.groupby(effects.solver[part.index]).median()
        return float(by_solver.median()) if len(part) >= MANY and len(by_solver) >= WITNESSES else otherwise

    of_all = of(log_ratio, 0.0)
    return log_ratio.groupby([effects[name] for name in TOGETHER]).transform(lambda part: of(part, of_all))


def main(words: list[str] | None = None) -> int:
    """Compare two runs and print; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m bench.comparison.matched", description="Compare two runs row by row.")
    parser.add_argument("a", type=Path, metavar="RUN_A")
    parser.add_argument("b", type=Path, metavar="RUN_B")
    parser.add_argument("--noise", nargs=2, type=Path, metavar=("AA_1", "AA_2"), help="two runs of the same field")
    parser.add_argument("--correction", choices=sorted(CORRECTIONS), default="bh")
    parser.add_argument("--what", default="interleaved_solve",
                        help="interleaved_solve, interleaved_update, solve, update or setup")
    asked = parser.parse_args(words)
    try:
        effects = effects_of(Run.open(asked.a), Run.open(asked.b), asked.what)
        noise = None
        if asked.noise:
            noise = noise_of(effects_of(Run.open(asked.noise[0]), Run.open(asked.noise[1]), asked.what))
    except RunError as error:
        print(f"compare_rows: {error}", file=sys.stderr)
        return 2
    _say(compare(effects, noise, asked.correction))
    return 0


def _say(found: Comparison) -> None:
    table = found.table
    shown = table[table.significant]
    shown = shown.assign(**{name: shown[name].map("{:.3f}".format) for name in ("ratio", "own_ratio")})
    columns = [*NAMES[1:], "ratio", "own_ratio", "p", "adjusted"]
    print_table(("problem", "scaling", "solver", "lane", "tier", "start", "settings", "b/a", "without shared", "p", "adjusted"),
                [[cell if isinstance(cell, str) else f"{cell:.1e}" for cell in row] for row in shown[columns].values.tolist()],
                left=7)
    shared = np.exp(found.shared) - 1.0
    console.print(f"{table.significant.sum()} of {len(table)} rows differ ({100 * found.share:.1f} %); noise band "
                  f"{100 * found.noise:.1f} %; what the rows of one problem in one scaling share is the machine's, from "
                  f"{100 * shared.min():+.0f} % to {100 * shared.max():+.0f} %.")


if __name__ == "__main__":
    sys.exit(main())
