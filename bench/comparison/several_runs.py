"""Several runs side by side.

*Side by side* are the problems that all of the runs have, which may be of several machines, instruction sets and
versions. Problems are the same if their digests are, whatever they are called. Accuracy does not depend on the machine:
an answer counts for its solver, version and setting. Times are those of each run. A ratio to the solver that does
nothing, or to one of LANES, compares machines better than microseconds do.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from bench.derived.measurements import FLOOR, Measurements
from bench.messages.columns import TYPICAL, Column, combined, worst
from bench.messages.task import Tier
from bench.report.report import Axis, Figure, Mark, Plot, Report, Table
from bench.report.words import OURS_NOTE, gap, marked, number
from bench.store import Run, RunError

LANES = ("box_active_set (direct)", "daqp (direct)")
"""Solver lanes over whose times, too, those of others are shown."""
SIDE_BY_SIDE = (
    Column("solver", heading="solver", format=marked),
    Column("lane", heading="lane"),
    Column("version", heading="version", format=lambda version: version.partition(",")[0]),
    Column("run", heading="run"),
    Column("right", None, "sum", "right"),
    Column("problems", None, "size", of="right"),
    Column("worst_cost_gap", None, None, "worst gap", gap),
    Column("answer_us", None, TYPICAL, "µs", number),
    Column("iterations", None, "sum"),
    Column("over_floor", None, TYPICAL, "over nothing", number),
    *(Column(base, None, TYPICAL, f"over {base}", number) for base in LANES),
)
KEY = ["solver", "lane", "version", "run"]


def combination(runs: Sequence[Run]) -> Report:
    """The report of finished one-shot races, at the tier high, or at the defaults of a lane that does not reach it;
    RunError if two have one name, or they have no problem in common."""
    names = [run.path.name for run in runs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise RunError(f"two runs are called {twice[0]}; rename a folder")
    parts = [_rows(run) for run in runs]
    common = set.intersection(*(set(part.digest) for part in parts))
    if not common:
        raise RunError("the runs have no problem in common; 'race --folder RUN/problems' races those of a run")
    alone = {name: part[~part.digest.isin(common)] for name, part in zip(names, parts, strict=True)}
    missing = {name: sorted((part.problem_set + "/" + part.problem).unique()) for name, part in alone.items()}
    table = side_by_side(pd.concat([part[part.digest.isin(common)] for part in parts], ignore_index=True))
    cells = table.assign(right=table.right.astype(str) + "/" + table.problems.astype(str))
    short = [column for column in SIDE_BY_SIDE if column.name not in ("worst_cost_gap", *LANES)]
    labels = table.solver + " (" + table.lane + ") " + table.version
    figure = Figure(
        "side_by_side",
        "Times side by side",
        "Median time of an answer over that of the solver that does nothing, by run.",
        table.assign(name=labels)[np.isfinite(table.over_floor)],
        [
            Plot(
                Axis("over_floor", "time over that of doing nothing", log=True),
                Axis("name"),
                (Mark("point", "run", size=60.0),),
                ("name", "run"),
            )
        ],
    )
    return Report(
        [
            f"{len(runs)} runs on {len(common)} common problem{'s' * (len(common) != 1)}: {table.solver.nunique()} "
            f"solvers in {len(table[['solver', 'lane']].drop_duplicates())} lanes."
        ],
        Table.of("Solvers side by side", cells, SIDE_BY_SIDE, 4, filters=("lane", "version", "run")),
        summary=table,
        figures=[figure],
        notes=[f"Only in {name}, and not counted: {', '.join(of_run)}." for name, of_run in missing.items() if of_run],
        definitions=(
            "right: answers within 1e-9, at the setting chosen for it in each run, else at the defaults.",
            "worst gap: over all runs with this version, since accuracy does not depend on the machine.",
            "over nothing, over a solver: medians over the problems of the ratio of times in the same run.",
            OURS_NOTE,
        ),
        environment=[(run.path.name, " and ".join(run.machine_names)) for run in runs],
        terminal=Table.of("Solvers side by side", cells, short, 4, note="Times in µs."),
        title="Runs side by side: " + ", ".join(names),
    )


def _rows(run: Run) -> pd.DataFrame:
    """The scaled or only rows of a run from cold starts, one setting for each solver lane, with versions and floor."""
    found = Measurements.of(run)
    rows = found.cold(found.tiers)
    high = rows[rows.tier == Tier.HIGH]
    lanes = [rows.solver, rows.lane]
    without = ~pd.MultiIndex.from_arrays(lanes).isin(pd.MultiIndex.from_frame(high[["solver", "lane"]]))
    rows = pd.concat([high, rows[without & (rows.tier == Tier.DEFAULT)]])
    floor = found.cold(found.rows[found.rows.solver == FLOOR]).set_index("digest").answer_us
    versions = run.settings.get("field", {})
    return rows.assign(
        run=run.path.name,
        version=[versions.get(f"{s} ({lane})", "") for s, lane in zip(rows.solver, rows.lane, strict=True)],
        over_floor=rows.answer_us / rows.digest.map(floor.groupby(level=0).median()),
    )


def side_by_side(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per KEY: the right answers over all problems, the worst gap of the solver's version over all runs, median
    time, and its ratios to the floor and LANES, medians over the problems."""
    lane = rows.solver + " (" + rows.lane + ")"
    for base in LANES:
        us = rows[lane == base].set_index(["run", "digest"]).answer_us
        pairs = pd.MultiIndex.from_frame(rows[["run", "digest"]])
        rows = rows.assign(**{base: rows.answer_us.to_numpy() / us.reindex(pairs).to_numpy()})
    pooled = rows.groupby(KEY[:3]).cost_gap.agg(worst).rename("worst_cost_gap")
    return combined(rows, SIDE_BY_SIDE, KEY).merge(pooled, on=KEY[:3]).sort_values(KEY, ignore_index=True)
