"""A solver over several runs, from version to version: iterations exactly, times by the rule of a comparison.

Iterations of the same task, a problem at a setting, are a property of the solver's version and of the data, and are
compared as sums over the tasks that both runs have; times are compared as in `bench.comparison.compare`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.comparison.compare import compare_runs
from bench.derived.measurements import Measurements
from bench.messages.verdict import Status
from bench.store import Run, RunError


@dataclass(frozen=True)
class Entry:
    """A solver lane in a run, compared with the first run."""

    run: str
    commit: str
    version: str
    lane: str
    iterations: int
    """Sum over the common tasks; 0 if the solver does not count them."""
    iterations_ratio: float
    time_ratio: float
    low: float
    high: float
    finding: str


def history(runs: Sequence[Run], solver: str, smallest: float) -> list[Entry]:
    """The entries of a solver's lanes in runs, in the order given; RunError if the first run does not have it."""
    first = Measurements.of(runs[0]).field
    if solver not in set(first.solver):
        raise RunError(f"{runs[0].path} has no solver {solver!r}")
    counted = first[(first.solver == solver) & (first.status == Status.OK)]
    found = []
    for run in runs:
        settings, comparison = run.settings, compare_runs(runs[0], run, smallest)
        rows = Measurements.of(run).field
        pairs = counted.merge(rows[rows.status == Status.OK], on="task", suffixes=("_a", ""))
        if not len(pairs):
            raise RunError(f"{run.path} has no task of {solver} in common with {runs[0].path}")
        lines = comparison.times[comparison.times.solver == solver].to_dict("records")
        times = {str(line["lane"]): line for line in lines}
        for name, part in pairs.groupby("lane"):
            lane, line = str(name), times.get(str(name), {})
            has = (part.iterations >= 0) & (part.iterations_a >= 0)
            before, after = int(part.iterations_a[has].sum()), int(part.iterations[has].sum())
            ratio, low, high = (float(line.get(key, np.nan)) for key in ("ratio", "ratio_low", "ratio_high"))
            found.append(
                Entry(
                    run.path.name,
                    settings["machine"].get("environment", {}).get("commit", ""),
                    settings.get("field", {}).get(f"{solver} ({lane})", ""),
                    lane,
                    after,
                    after / before if before else np.nan,
                    ratio,
                    low,
                    high,
                    str(line.get("finding", "")),
                )
            )
    return found


def regressions(entries: Sequence[Entry], iterations: float, times: float) -> list[str]:
    """A sentence for each entry whose iterations or times exceed those of the first run by these ratios; a time does if
    the lower end of its interval excludes no change."""
    found = []
    for entry in entries:
        name = f"{entry.run}, {entry.lane}, {entry.version or 'no version'}"
        if entry.iterations_ratio > iterations:
            found.append(f"{name}: {entry.iterations_ratio:.3f} times as many iterations")
        if entry.time_ratio > times and entry.low > 1.0:
            found.append(f"{name}: {entry.time_ratio:.2f} times as long ({entry.low:.2f} to {entry.high:.2f})")
    return found
