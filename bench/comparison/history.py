"""A solver over several runs, from version to version: iterations exactly, times by the rule of a comparison.

Iterations of the same task, a problem at a setting, are a property of the solver's version and of the data, and are
compared as sums over the tasks that both runs have; times are compared as in `bench.comparison.compare`.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from bench.comparison.compare import compare_runs
from bench.derived.measurements import Measurements
from bench.messages.columns import Column
from bench.messages.task import Status
from bench.report.words import number
from bench.store import Run, RunError

COLUMNS = (
    *(Column(name, heading=name, format=lambda text: text or "–") for name in ("run", "commit", "version", "lane")),
    Column("iterations", heading="iterations"),
    Column("iterations_ratio", heading="ratio", format=number),
    Column("time_ratio", heading="time ratio", format=number),
    Column(
        "interval",
        heading="interval",
        format=lambda ends: "unknown" if ends[1] == np.inf else " to ".join(map(number, ends)),
    ),
    Column("finding", heading="times", format=lambda text: text or "–"),
)


def history(runs: Sequence[Run], solver: str, smallest: float) -> pd.DataFrame:
    """COLUMNS, one row for each lane of a solver in each run, compared with the first run; RunError if that does not
    have it. ``iterations`` is their sum over the common tasks, 0 if the solver does not count them."""
    first = Measurements.of(runs[0])
    if solver not in set(first.field.solver):
        raise RunError(f"{runs[0].path} has no solver {solver!r}")
    counted = first.field[(first.field.solver == solver) & (first.field.status == Status.OK)]
    found = []
    for run in runs:
        settings, measured = run.settings, first if run is runs[0] else Measurements.of(run)
        comparison, rows = compare_runs(runs[0], run, smallest, (first, measured)), measured.field
        pairs = counted.merge(rows[rows.status == Status.OK], on="task", suffixes=("_a", ""))
        if not len(pairs):
            raise RunError(f"{run.path} has no task of {solver} in common with {runs[0].path}")
        lines = comparison.times[comparison.times.solver == solver].to_dict("records")
        times = {str(line["lane"]): line for line in lines}
        for name, part in pairs.groupby("lane"):
            lane, line = str(name), times.get(str(name), {})
            has = (part.iterations >= 0) & (part.iterations_a >= 0)
            before, after = int(part.iterations_a[has].sum()), int(part.iterations[has].sum())
            found.append(
                {
                    "run": run.path.name,
                    "commit": settings["machine"].get("environment", {}).get("commit", "")[:12],
                    "version": settings.get("field", {}).get(f"{solver} ({lane})", ""),
                    "lane": lane,
                    "iterations": after,
                    "iterations_ratio": after / before if before else np.nan,
                    "time_ratio": float(line.get("ratio", np.nan)),
                    "interval": tuple(float(line.get(f"ratio_{end}", np.nan)) for end in ("low", "high")),
                    "finding": str(line.get("finding", "")),
                }
            )
    return pd.DataFrame(found)


def regressions(table: pd.DataFrame, iterations: float, times: float) -> list[str]:
    """A sentence for each row whose iterations or times exceed those of the first run by these ratios; a time does if
    the lower end of its interval excludes no change."""
    found = []
    for line in table.to_dict("records"):
        name, (low, high) = f"{line['run']}, {line['lane']}, {line['version'] or 'no version'}", line["interval"]
        if line["iterations_ratio"] > iterations:
            found.append(f"{name}: {line['iterations_ratio']:.3f} times as many iterations")
        if line["time_ratio"] > times and low > 1.0:
            found.append(f"{name}: {line['time_ratio']:.2f} times as long ({low:.2f} to {high:.2f})")
    return found
