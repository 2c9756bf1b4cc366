"""Report of a comparison: sentences, a table with one row per solver lane; as page, Markdown and JSON."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.comparison.compare import CANNOT_TELL, FASTER, SAME, SHOWN, SLOWER, SOLVER_LANE, Comparison, Comparisons
from bench.derived.ranking import TIER_NAMES
from bench.messages.columns import Column
from bench.messages.task import Tier
from bench.report.console import plain_json
from bench.report.report import Report, Table
from bench.report.words import OURS_NOTE, joined, marked, solver_lanes
from bench.report.writing import write_report
from bench.store import Run
from bench.timing import machine
from piezo_model.atomic_file import write_text

FORMAT, VERSION = "piezobench-comparison", 5
COLUMNS = (
    Column("solver", heading="solver", format=marked),
    Column("lane", heading="lane"),
    Column("run", heading="run"),
    *(column for column in SHOWN if column.heading),
    Column("ratio", heading="ratio", format=lambda ratio: "–" if pd.isna(ratio) else f"{ratio:.2f}"),
    Column("finding", heading="finding"),
    Column("interval", heading="interval"),
    Column("timed", heading="times"),
)
ORDER = (SLOWER, FASTER, CANNOT_TELL, SAME)
MOST_NAMED, MOST_SHOWN = 4, 2
"""Most solver lanes in a sentence about rows of one run only, and most differences in a warning."""
IGNORED = ("effort", "time_limit_s", "memory_mb", "solver_files", "problem_sets", "set_options", "problems", "limit")
"""Settings that do not affect the comparison, whose effect the times show, or that name what a digest identifies."""
DEFINITIONS = (
    "µs: the median over the problems that all runs have in common of the time of update and solve, at the setting "
    "with which the first run reaches 1e-9 on most of them; to daqp and to floor: the median of that time over those "
    "of daqp in the same lane and of a solver that does nothing. right: on how many problems no answer misses 1e-9; "
    "misses, at most: the upper 95 % limit of the rate at which timed answers miss it, on the worst problem.",
    "ratio: update and solve in the second run over the first at equal settings, median over the problems; "
    "hot or interleaved with the other solvers, whichever deviates less. What the field has in common "
    "on a problem is taken for the machine's and divided out.",
    "interval: 95 % by bootstrap over the problems, wider by five median absolute deviations of the solver lanes at "
    "either end, since most of them do not change and yet differ. A lane is slower or faster where it excludes 1.",
    "cannot tell: the interval holds 1 and the smallest ratio that matters, too, or the lanes deviate by more than 3 "
    "% (a sixth of that ratio's logarithm), or there are fewer than three lanes, or three problems of one. Three or "
    "four lanes are taken to deviate by at least 4 %.",
    "lost: one setting that both have reached the tier in the first run and none does in the second, and there, with "
    "that setting, a first answer is wrong, or more timed answers than by chance (p < 0.001 if their rate had stayed).",
    "A regression is a solver lane that became slower or fails where it did not, or a tier that was lost. What only "
    "one of the runs has is not compared.",
    OURS_NOTE,
)


def report(compared: Comparisons) -> Report:
    """Report of comparisons with the same first run."""
    pairs, runs = compared.pairs, compared.runs
    page, terminal = (
        Table.of("Runs side by side", _lines(compared), columns, 2, filters=("run", "lane"))
        for columns in (COLUMNS, COLUMNS[:-2])  # a terminal has no room
    )
    return Report(
        [
            *(f"WARNING: {warning}" for comparison in pairs for warning in warnings(comparison)),
            in_common(compared),
            *(sentence for comparison in pairs for sentence in sentences(comparison)),
        ],
        page,
        notes=[
            *(note for comparison in pairs for note in notes(comparison)),
            *(line for run in runs for line in machine.elsewhere(f"The run {run.path.name}", run.machine_names)),
        ],
        definitions=DEFINITIONS,
        environment=[(run.path.name, str(run.path)) for run in runs],
        terminal=terminal,
        title="Comparison of " + ", ".join(run.path.name for run in runs),
    )


def in_common(compared: Comparisons) -> str:
    """What the runs share, with their numbers in the table."""
    problems, lanes = (len(compared.common[of].drop_duplicates()) for of in (["digest"], SOLVER_LANE))
    return (
        f"{joined(f'{run.path.name} ({number})' for number, run in enumerate(compared.runs, 1))} have {problems} "
        f"problem{'s' if problems > 1 else ''}, {solver_lanes(lanes)} and {len(compared.common)} rows in common."
    )


def write(compared: Comparisons, report: Report, folder: Path) -> Path:
    """Write ``comparison.html``, ``.md`` and ``.json``; returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "comparison.json", json.dumps(to_dict(compared), indent=1, allow_nan=False) + "\n")
    return write_report(report, folder, "comparison").with_suffix(".html")


def to_dict(compared: Comparisons) -> dict[str, Any]:
    """The comparisons as a JSON document; null is an unknown number."""
    return plain_json(
        {
            "format": FORMAT,
            "version": VERSION,
            "runs": [str(run.path) for run in compared.runs],
            "common": len(compared.common),
            "lines": compared.lines.to_dict("records"),
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
                    "failed": comparison.failed.to_dict("records"),
                    "lost": comparison.lost.to_dict("records"),
                    "gained": comparison.gained.to_dict("records"),
                }
                for comparison in compared.pairs
            ],
        }
    )


def sentences(comparison: Comparison) -> list[str]:
    """The findings, and the changes that could not have been found."""
    lanes, unseen, count = len(comparison.times), comparison.count(CANNOT_TELL), len(comparison.failed)
    counts = [
        *(
            f"{solver_lanes(number, lanes)} {'is' if number == 1 else 'are'} {finding}"
            for finding in (SLOWER, FASTER)
            if (number := comparison.count(finding))
        ),
        *(
            f"{len(tiers)} tier{'s are' if len(tiers) > 1 else ' is'} {what}"
            for what, tiers in (("lost", comparison.lost), ("gained", comparison.gained))
            if len(tiers)
        ),
        f"{count} solver lane{'s fail' if count > 1 else ' fails'} on common problems: {_named(comparison.failed)}",
    ][: None if count else -1]
    same = f"no difference{' detected' if comparison.cannot_tell else ''} in {solver_lanes(lanes)}"
    noise = joined(
        f"{100.0 * deviation:.1f} % {timed}"
        for timed, deviation in comparison.field.deviation.items()
        if np.isfinite(deviation)
    )
    why = f"lanes deviate from each other by {noise}" if noise else "too few lanes race to tell a change from noise"
    factors = joined(f"{factor:.2f} {timed}" for timed, factor in comparison.field.factor.items())
    beside = (
        f", and the reference workload timed beside it by {comparison.sentinel:.2f}: either the machine changed in "
        "a way that this workload does not show, or most solvers did"
        if comparison.moved
        else ", which is divided out"
    )
    sentence_if = {
        f"{comparison.b.path.name} against {comparison.a.path.name}: {joined(counts) or same}.": True,
        f"In {solver_lanes(unseen, lanes)} a change by a factor of {comparison.smallest:g} may have gone unseen: {why}"
        ". A quiet machine, more problems and --repeats help.": unseen,
        f"The field as a whole changed by a factor of {factors}{beside}.": factors,
    }
    return [sentence for sentence, applies in sentence_if.items() if applies]


def _named(rows: pd.DataFrame) -> str:
    """The solver lanes of rows, those with most rows first."""
    names = [
        f"{marked(solver)} ({lane})" for solver, lane in rows.groupby(SOLVER_LANE).size().sort_values().index[::-1]
    ]
    return ", ".join(names[:MOST_NAMED]) + (f" and {more} others" if (more := len(names) - MOST_NAMED) > 0 else "")


def notes(comparison: Comparison) -> list[str]:
    """A sentence for each run about the rows that only it has."""
    return [
        f"Only {run.path.name} has {len(rows)} row{'s' if len(rows) > 1 else ''}, of {_named(rows)}."
        for run, rows in zip((comparison.a, comparison.b), comparison.alone, strict=True)
        if len(rows)
    ]


def warnings(comparison: Comparison) -> list[str]:
    """Differences between machines, settings and versions."""
    first, second = _conditions(comparison.a), _conditions(comparison.b)
    differ = {
        what: [
            f"{name} is {of[name]} in the first run and {second[what][name]} in the second"
            for name in sorted(of.keys() & second[what].keys())
            if of[name] != second[what][name]
        ]
        for what, of in first.items()
    }
    listed = {
        what: [*those[:MOST_SHOWN], *([f"{len(those) - MOST_SHOWN} more"] if len(those) > MOST_SHOWN else [])]
        for what, those in differ.items()
    }
    return [f"Different {what}: {'; '.join(those)}." for what, those in listed.items() if those]


def _conditions(run: Run) -> dict[str, Mapping[str, str]]:
    """Machines, settings and versions of a run, as texts that do not depend on the order in a list."""
    settings, machines = run.settings, [*run.machines.values()]
    chosen, packages = settings["settings"], {name for host in machines for name in host["versions"]}
    return {
        "machines": {
            name: joined(sorted({str(host.get(name)) for host in machines}))
            for name in ("processor", "cores", "system", "python", "core")
        },
        "settings": {
            name: (", ".join(sorted(map(str, value))) or "all") if isinstance(value, list) else str(value)
            for name, value in (chosen | (chosen.get("effort") or {})).items()
            if name not in IGNORED
        },
        "packages": {
            name: joined(sorted({host["versions"].get(name, "absent") for host in machines})) for name in packages
        },
        "solvers": settings.get("lanes", {}),
    }


def _lines(compared: Comparisons) -> pd.DataFrame:
    """The lines of all runs with the findings, the lanes that changed first."""
    by, numbered = [*SOLVER_LANE, "run"], [*enumerate(compared.pairs, 2)]
    tiers = [
        changed.assign(
            run=run, tiers=what + changed.tier.map(lambda tier: TIER_NAMES[Tier(tier)]) + " " + changed.scaling
        )
        for run, comparison in numbered
        for what, changed in (("lost ", comparison.lost), ("gained ", comparison.gained))
    ]
    changes = pd.concat([table for table in tiers if len(table)] or tiers[:1]).groupby(by).tiers.agg(", ".join)
    times = pd.concat([comparison.times.drop(columns="problems").assign(run=run) for run, comparison in numbered])
    table = compared.lines.merge(times, on=by, how="outer").join(changes, on=by)
    order = table.finding.map(dict(zip(ORDER, range(-len(ORDER), 0), strict=True))) - len(ORDER) * table.tiers.notna()
    lane = [table.solver, table.lane]
    return table.assign(
        right=[
            f"{right:.0f}/{of:.0f}" if of > 0 else "–" for right, of in zip(table.right, table.problems, strict=True)
        ],
        finding=table.tiers.str.cat(table.finding.replace(SAME, None), ", ")
        .fillna(table.tiers)
        .fillna(table.finding.replace(SAME, "same"))
        .fillna("–"),
        interval=[
            f"{low:.2f} to {high:.2f}" if low > 0.0 else "unknown" if low == 0.0 else "–"
            for low, high in zip(table.ratio_low, table.ratio_high, strict=True)
        ],
        timed=table.timed.fillna("–"),
        order=order.fillna(0).groupby(lane).transform("min"),
        size=-np.log(table.ratio).abs().groupby(lane).transform("max"),
    ).sort_values(["order", "size", *by], ignore_index=True)
