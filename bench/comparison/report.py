"""Report of a comparison: sentences, a table with one row per solver lane; as page, Markdown and JSON."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.comparison.compare import CANNOT_TELL, FASTER, SAME, SLOWER, SOLVER_LANE, Comparison
from bench.derived.ranking import TIER_NAMES
from bench.messages.columns import Column
from bench.messages.task import Tier
from bench.report.console import plain_json
from bench.report.report import Report, Table
from bench.report.words import OURS_NOTE, joined, marked, solver_lanes, whole
from bench.report.writing import write_report
from bench.store import Run
from piezo_model.atomic_file import write_text

FORMAT, VERSION = "piezobench-comparison", 4
COLUMNS = (
    Column("run", heading="run"),
    Column("solver", heading="solver", format=marked),
    Column("lane", heading="lane"),
    Column("timed", heading="times"),
    Column("finding", heading="finding"),
    Column("ratio", heading="ratio", format=lambda ratio: "–" if pd.isna(ratio) else f"{ratio:.2f}"),
    Column("interval", heading="interval"),
    Column("problems", heading="problems", format=whole),
    Column("tiers", heading="tiers"),
)
ORDER = (SLOWER, FASTER, CANNOT_TELL, SAME)
MOST_NAMED, MOST_TOLD = 4, 2
"""Most solver lanes in a sentence about rows of one run only, and most differences in a warning."""
IGNORED = ("effort", "time_limit_s", "memory_mb", "solver_files")
"""Settings that do not affect the comparison, or whose effect the times show."""
DEFINITIONS = (
    "ratio: update and solve in the second run over the first at equal settings, median over the problems; "
    "hot or interleaved with the other solvers, whichever deviates less. What the field has in common "
    "on a problem is taken for the machine's and divided out.",
    "interval: 95 % by bootstrap over the problems, wider by five median absolute deviations of the solver lanes at "
    "either end, since most of them do not change and yet differ. A lane is slower or faster where it excludes 1.",
    "cannot tell: the interval holds 1 and the smallest ratio that matters, too, or the lanes deviate by more than 3 "
    "% (a sixth of that ratio's logarithm), or there are fewer than three lanes, or three problems of one. Three or "
    "four lanes are taken to deviate by at least 4 %.",
    "tiers: a tier is lost for which one setting was right on every problem in the first run and none is in the "
    "second, unless by chance. Each run draws the data of its timed answers anew: six problems more, or all, have to "
    "become wrong, or with the same seed one by its first answer.",
    "A regression is a solver lane that became slower or fails where it did not, a tier that was lost, or that the "
    "runs have nothing in common. What only one of the runs has is not compared.",
    OURS_NOTE,
)


def report(comparisons: Sequence[Comparison]) -> Report:
    """Report of comparisons with the same first run."""
    every = pd.concat([_table(comparison) for comparison in comparisons], ignore_index=True)
    changed = every[~every.finding.isin([SAME, "–"]) | (every.tiers != "–")]
    first = 0 if len(comparisons) > 1 else 1
    grid = [
        Table.of(title, lines, COLUMNS[first:], 5 - first, filters=("run", "lane", "times", "finding"))
        for title, lines in (("Solver lanes", every), ("Solver lanes that differ or cannot be told", changed))
    ]
    runs = [comparisons[0].a, *(comparison.b for comparison in comparisons)]
    return Report(
        [
            *(f"WARNING: {warning}" for comparison in comparisons for warning in warnings(comparison)),
            *(sentence for comparison in comparisons for sentence in sentences(comparison)),
        ],
        grid[0],
        notes=[note for comparison in comparisons for note in notes(comparison)],
        definitions=DEFINITIONS,
        environment=[(run.path.name, str(run.path)) for run in runs],
        terminal=grid[1],
        title="Comparison of " + ", ".join(run.path.name for run in runs),
    )


def write(comparisons: Sequence[Comparison], report: Report, folder: Path) -> Path:
    """Write ``comparison.html``, ``.md`` and ``.json``; returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "comparison.json", json.dumps(to_dict(comparisons), indent=1, allow_nan=False) + "\n")
    return write_report(report, folder, "comparison").with_suffix(".html")


def to_dict(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """The comparisons as a JSON document; null is an unknown number."""
    return plain_json(
        {
            "format": FORMAT,
            "version": VERSION,
            "baseline": str(comparisons[0].a.path),
            "comparisons": [
                {
                    "run": str(comparison.b.path),
                    "warnings": warnings(comparison),
                    "notes": notes(comparison),
                    "verdict": sentences(comparison),
                    "difference": bool(comparison.differences),
                    "regressions": comparison.regressions,
                    "cannot_tell": comparison.cannot_tell,
                    "smallest": comparison.smallest,
                    "field": comparison.field.to_dict("index"),
                    "lines": comparison.times.to_dict("records"),
                    "common": comparison.common,
                    "failed": comparison.failed.to_dict("records"),
                    "lost": comparison.lost.to_dict("records"),
                    "gained": comparison.gained.to_dict("records"),
                }
                for comparison in comparisons
            ],
        }
    )


def sentences(comparison: Comparison) -> list[str]:
    """The findings, and the changes that could not have been found."""
    lanes = len(comparison.times)
    counts = [
        f"{solver_lanes(count, lanes)} {'is' if count == 1 else 'are'} {finding}"
        for finding in (SLOWER, FASTER)
        if (count := comparison.count(finding))
    ]
    counts += [
        f"{len(tiers)} tier{'s are' if len(tiers) > 1 else ' is'} {what}"
        for what, tiers in (("lost", comparison.lost), ("gained", comparison.gained))
        if len(tiers)
    ]
    if count := len(comparison.failed):
        pairs = comparison.failed[:MOST_NAMED].astype(str).to_numpy().tolist()
        names = [f"{marked(solver)} ({lane})" for solver, lane in pairs]
        counts.append(
            f"{count} solver lane{'s fail' if count > 1 else ' fails'} on common problems: {', '.join(names)}"
        )
    name = f"{comparison.b.path.name} against {comparison.a.path.name}"
    if not comparison.common:
        return [f"{name}: the runs have no row in common, and so nothing was compared; the notes name what each has."]
    unseen = " that can be told" if comparison.cannot_tell else ""
    found = [f"{name}: {joined(counts) or f'no difference{unseen} in {solver_lanes(lanes)}'}."]
    if count := comparison.count(CANNOT_TELL):
        noise = joined(
            f"{100.0 * deviation:.1f} % {timed}"
            for timed, deviation in comparison.field.deviation.items()
            if np.isfinite(deviation)
        )
        why = f"lanes deviate from each other by {noise}" if noise else "too few lanes race to tell a change from noise"
        found.append(
            f"In {solver_lanes(count, lanes)} a change by a factor of {comparison.smallest:g} may have gone unseen: "
            f"{why}. A quiet machine, more problems and --repeats help."
        )
    factors = joined(f"{factor:.2f} {timed}" for timed, factor in comparison.field.factor.items())
    beside = (
        f", and the fixed piece of work timed beside it by {comparison.sentinel:.2f}: either the machine changed in a "
        "way that this work does not feel, or most solvers did"
        if comparison.moved
        else ", which is divided out"
    )
    return [*found, f"The field as a whole changed by a factor of {factors}{beside}."] if factors else found


def notes(comparison: Comparison) -> list[str]:
    """A sentence for each run about the rows that only it has."""
    found = []
    for run, rows in zip((comparison.a, comparison.b), comparison.alone, strict=True):
        names = [f"{marked(solver)} ({lane})" for solver, lane in rows[SOLVER_LANE].value_counts().index]
        more = f" and {len(names) - MOST_NAMED} others" if len(names) > MOST_NAMED else ""
        count = f"{len(rows)} row{'s' if len(rows) > 1 else ''}"
        found += [f"Only {run.path.name} has {count}, of {', '.join(names[:MOST_NAMED])}{more}."] if names else []
    return found


def warnings(comparison: Comparison) -> list[str]:
    """Differences between machines, settings and versions."""
    pairs = zip(_conditions(comparison.a).items(), _conditions(comparison.b).values(), strict=True)
    found = []
    for (what, first), second in pairs:
        differ = [
            f"{name} is {_text(first[name])} in the first run and {_text(second[name])} in the second"
            for name in sorted(first.keys() & second.keys())
            if _text(first[name]) != _text(second[name])
        ]
        more = f"; {len(differ) - MOST_TOLD} more" if len(differ) > MOST_TOLD else ""
        found += [f"Different {what}: {'; '.join(differ[:MOST_TOLD])}{more}."] if differ else []
    return found


def _conditions(run: Run) -> dict[str, Mapping[str, Any]]:
    """Machines, settings and versions of a run."""
    settings, machines = run.settings, [*run.machines.values()]
    chosen, packages = settings["settings"], {name for each in machines for name in each["versions"]}
    return {
        "machines": {
            name: joined(sorted({str(each.get(name)) for each in machines}))
            for name in ("processor", "cores", "system", "python", "core")
        },
        "settings": {
            name: value for name, value in (chosen | (chosen.get("effort") or {})).items() if name not in IGNORED
        },
        "packages": {
            name: joined(sorted({each["versions"].get(name, "absent") for each in machines})) for name in packages
        },
        "solvers": settings.get("field", {}),
    }


def _text(value: Any) -> str:
    """A setting as text, independent of the order in a list."""
    return (", ".join(sorted(map(str, value))) or "all") if isinstance(value, list) else str(value)


def _table(comparison: Comparison) -> pd.DataFrame:
    """The times with the lost and gained tiers, changes first."""
    parts = [
        tiers.assign(tiers=what + tiers.tier.map(lambda tier: TIER_NAMES[Tier(tier)]) + " " + tiers.scaling)
        for what, tiers in (("lost ", comparison.lost), ("gained ", comparison.gained))
        if len(tiers)
    ]
    changed = (
        pd.concat([pd.DataFrame(columns=[*SOLVER_LANE, "tiers"], dtype=str), *parts])
        .groupby(SOLVER_LANE)
        .tiers.agg(", ".join)
        .reset_index()
    )
    table = comparison.times.merge(changed, on=SOLVER_LANE, how="outer").fillna(
        {"tiers": "–", "timed": "–", "finding": "–", "problems": 0}
    )
    order = table.finding.map({finding: i for i, finding in enumerate(ORDER)}) - len(ORDER) * (table.tiers != "–")
    intervals = [
        f"{low:.2f} to {high:.2f}" if low > 0.0 else "unknown"
        for low, high in zip(table.ratio_low, table.ratio_high, strict=True)
    ]
    return (
        table.assign(run=comparison.b.path.name, interval=intervals, order=order, size=-np.log(table.ratio).abs())
        .sort_values(["order", "size"], ignore_index=True)
        .drop(columns=["order", "size"])
    )
