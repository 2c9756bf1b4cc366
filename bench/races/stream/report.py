"""The report of a stream race."""

import json
import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from bench.derived.tiers import failed
from bench.messages.columns import Column
from bench.messages.task import PAPER, Status
from bench.races.chosen_settings import definition, tier_label
from bench.races.kind import Kind
from bench.races.stream import summary as summaries
from bench.races.stream.race import STREAM, StreamRace, StreamSettings
from bench.races.stream.summary import FAILURES, FLOOR_NAME, column
from bench.report.report import Axis, Figure, Plot, Report, Table, best_lines
from bench.report.words import OURS_NOTE, gap, marked, number, percent, settings_label, share, solver_lanes
from bench.store import Run
from bench.timing.percentiles import QUANTILES, Percentile, needed
from bench.timing.schedule import PERIOD_NS, PERIOD_US

EXACT = "box_active_set"
TOLD = 4.0
"""Largest ratio of rates that may be left open where a sentence says that two rates do not differ."""
ONE_STEP = json.dumps({"steps": 1})
NAMES = ("solver", "lane", "tier", "settings")
PERCENTILES = {
    kind: (
        *(Column(f"{kind} {Percentile(q).name}", heading=Percentile(q).name) for q in QUANTILES),
        Column(f"{kind}_max_us", heading="max", format=number),
    )
    for kind in ("response", "service")
}
TEXTS = (
    Column("tier_label", heading="tier"),
    Column("late", heading="missed"),
    Column("beside_machine", heading="times the machine's"),
)


def definitions(settings: StreamSettings) -> tuple[str, ...]:
    """Definitions of the terms."""
    return (
        "Sample k is due at t₀ + k · 125 µs, whatever happened before. A solver that is still busy then continues with "
        "the newest due sample and the data of the samples that it missed. Response time: from the due time of a "
        "sample to the end of the first solve that includes it. Service time: from the start to the end of update and "
        "solve. A deadline is missed if the response time is above 125 µs. A bout is a run of missed deadlines.",
        "P and q are updated before the due time if there is time, and never within the service time.",
        "The floor is a solver that answers at once: the machine itself. Its bouts are what the machine does to every "
        "solver, and a solver is late if the whole 95 % interval of the ratio of the rates of bouts, given their sum, "
        "is above 1. The interval of a percentile marked ≈ floor overlaps that of the floor.",
        "Percentiles are order statistics with distribution-free 95 % intervals; a percentile that the sample does not "
        "support is refused with the number of samples it needs. The intervals assume independent samples; delays come "
        "in bursts, so the true intervals are wider.",
        "Gap: the cost of the answer in use at the deadline of each sample above the optimum of that sample, over the "
        "optimal cost, or its violation of the bounds over the largest number of the optimum if that is more: in "
        f"doubles at all samples, against box_active_set, and exact at {settings.certified} instants with proven "
        "optima. Own answers: the largest gap of an answer at its own sample. Reused: samples at whose deadline an "
        "older answer was in use.",
        f"A lane whose answers to the first {settings.give_up} samples are all late is stopped there. Every lane, the "
        "kernel's too, is called from Python for each sample, and runs in a fresh process after an untimed warm-up on "
        "the same rows, without garbage collection, on one thread and one core.",
        definition(settings.settings_run),
        OURS_NOTE,
    )


def report(run: Run, settings: StreamSettings) -> Report:
    """The report of a finished run."""
    rows, times = run.rows(STREAM), run.times()
    table = summaries.summary(rows, times)
    lines = summaries.lines(table, rows, times)
    shown = [
        Figure(
            "latency_tails",
            "Latency tails",
            "Response time by percentile, as far as the number of samples supports it; lower is better, and above the "
            f"dashed line the deadline is missed. In colour: {FLOOR_NAME}, a solver that answers at once, "
            "and the lanes with the lowest p99.",
            summaries.latency_tails(lines),
            [
                Plot(
                    Axis(
                        "one_in",
                        "percentile of the samples",
                        log=True,
                        values=[10.0**k for k in range(1, 7)],
                        label="'p' + format(100 * (1 - 1 / datum.value), '.6~f')",
                    ),
                    Axis("us", "response time, µs", log=True),
                    best_lines(),
                    rules={"y": PERIOD_US},
                )
            ],
        ),
        Figure(
            "deadline_profile",
            "Deadline profile",
            "Share of samples answered within k sampling periods of their due time. The deadline is one period.",
            summaries.deadline_profile(lines),
            [
                Plot(
                    Axis("periods", f"k: periods of {PERIOD_US:g} µs after the due time", log=True),
                    Axis("share", "share of samples answered within k periods", format="%", domain=(0.0, 1.0)),
                    best_lines("step"),
                )
            ],
        ),
    ]
    return replace(
        report_of(table, settings, shown),
        failed=failed(
            rows.assign(
                error=rows.own_gap_max.where(rows.unanswered == 0).fillna(math.inf).mask(rows.status == Status.OK, 0.0)
            ),
            run.settings.get("own", {}),
        ),
    )


def report_of(table: pd.DataFrame, settings: StreamSettings, shown: Sequence[Figure] = ()) -> Report:
    """The report of a summary, the settings of the race and its figures."""
    texts = _with_texts(table)
    response, service = PERCENTILES["response"], PERCENTILES["service"]
    tables = [
        Table.of(
            "Response time on the schedule, µs: due time to answer",
            texts,
            (*_columns(*NAMES), *response, *_columns("late", "stalls", "beside_machine", "status")),
            len(NAMES),
        ),
        Table.of(
            "Service time on the schedule, µs: begin to answer",
            texts,
            (*_columns(*NAMES), *service, *_columns("update_us_p50", "solve_us_p50", "solves", "stopped")),
            len(NAMES),
        ),
        Table.of(
            "Relative cost gap of the answer in use",
            texts,
            (
                *_columns(*NAMES, "gap_mean", "gap_max", "exact_gap_mean", "exact_gap_max"),
                *_columns("own_gap_max", "reused", "unanswered"),
            ),
            len(NAMES),
        ),
        Table.of("What went wrong", texts[texts.message != ""], _columns(*NAMES, "status", "message"), len(NAMES) + 2),
    ]
    return Report(
        verdict(table, settings),
        ranking(table),
        table,
        figures=shown,
        notes=notes(table, settings),
        tables=tables,
        definitions=definitions(settings),
        limits=["The operating system is not a real-time one."],
    )


def _columns(*names: str) -> list[Column]:
    """Columns of the tables by name; the tier with the basis of its setting."""
    known = {each.name: each for each in (*STREAM.columns, *TEXTS)}
    return [known["tier_label" if name == "tier" else name] for name in names]


def _with_texts(table: pd.DataFrame) -> pd.DataFrame:
    """The summary with TEXTS, and with percentiles as texts: value and interval, marked if it is not above the
    machine's floor, or the number of samples that it needs."""
    lines = table.to_dict("records")
    texts = {
        "tier_label": [tier_label(line["tier"], line["basis"]) for line in lines],
        "late": [f"{line['missed']:.0f}/{line['samples']}" for line in lines],
        "beside_machine": [
            "–" if line["is_floor"] else f"{number(line['bouts_ratio_low'])} to {number(line['bouts_ratio_high'])}"
            for line in lines
        ],
        **{
            f"{kind} {Percentile(q).name}": [_percentile(line, kind, q) for line in lines]
            for kind in PERCENTILES
            for q in QUANTILES
        },
    }
    return table.assign(**texts)


def _percentile(line: Mapping[Hashable, Any], kind: str, q: float) -> str:
    """A percentile and its interval, marked if it is not above the machine's floor, or the number of samples that it
    needs."""
    value, low, high = (line[column(kind, q, end)] for end in ("", "low", "high"))
    at_floor = kind == "response" and not line["is_floor"] and line[f"at_floor_{Percentile(q).name}"]
    interval = f"{number(value)} ({number(low)} to {number(high)}){' ≈ floor' * at_floor}"
    return f"needs {needed(q)}" if math.isnan(value) else interval


def ranking(table: pd.DataFrame) -> Table:
    """Table of the solvers that keep the schedule; the paper's method first, then the floor."""
    paper = (table.solver == PAPER) & (table.settings == ONE_STEP)
    tail = max((q for q in QUANTILES if table[column("response", q)].notna().any()), default=QUANTILES[0])
    lines = pd.concat([table[paper], table[~paper]])
    lines = lines.assign(
        schedule=[_schedule(line) for _, line in lines.iterrows()],
        setting=[settings_label(line.settings) or tier_label(line.tier, line.basis) for _, line in lines.iterrows()],
        median_us=lines[column("response", QUANTILES[0])],
        tail_us=lines[column("response", tail)],
        missed=lines.missed / lines.samples.where(lines.samples > 0),
    )
    return Table.of(
        "Who keeps the schedule",
        lines,
        (
            Column("solver", heading="solver", format=marked),
            Column("lane", heading="lane"),
            Column("setting", heading="setting"),
            Column("schedule", heading="schedule"),
            Column("median_us", heading="p50, µs", format=number),
            Column("tail_us", heading=f"{Percentile(tail).name}, µs", format=number),
            Column("missed", heading="missed", format=share),
            Column("gap_mean", heading="mean gap", format=gap),
            Column("gap_max", heading="worst gap", format=gap),
        ),
        3,
        filters=("lane", "schedule"),
        note="Response time by percentile. Missed: answers later than "
        f"{PERIOD_US:g} µs. Gap: the cost of the answer in use above the optimum of its sample, over that optimum. "
        f"{OURS_NOTE}",
    )


def _schedule(line: pd.Series) -> str:
    """Whether a solver keeps the schedule, in one word."""
    if line.is_floor:
        return "floor"
    if line.keeps_up:
        return "kept"
    return str(line.status) if line.machine_keeps or line.status in FAILURES else "unknown"


def verdict(table: pd.DataFrame, settings: StreamSettings) -> list[str]:
    """Sentences on the solvers that keep the schedule, if the machine permits any, and on the cost of stale answers."""
    floor, field = table[table.is_floor], table[~table.is_floor]
    sentences = []
    if not table.machine_keeps.all():
        sentences.append(
            "This run cannot say who keeps the schedule: the machine itself misses "
            f"{100.0 * floor.missed.iloc[0] / floor.samples.iloc[0]:.2g} % of the deadlines; it was "
            "busy or is too slow."
        )
    elif len(field):
        kept = field[field.keeps_up & (field.status == Status.OK)]
        sentences.append(
            f"{solver_lanes(len(kept), len(field), 'keep')} the schedule of {1e6 / PERIOD_NS:g} kHz: they reach their "
            "tier, and their bouts of late answers are not shown to be more frequent than the machine's own"
            + (
                f"; the fastest is {marked(kept.solver.iloc[0])} ({kept.lane.iloc[0]}), with a response time of "
                f"{_tail(kept.iloc[0])} and {bouts(kept.iloc[0])}."
                if len(kept)
                else "."
            )
        )
    return sentences + _staleness(table, settings)


def bouts(line: pd.Series) -> str:
    """Bouts of late answers, and how often they come beside those of the machine.

    Examples
    --------
    >>> bouts(pd.Series({"stalls": 3, "bouts_ratio_low": 0.4, "bouts_ratio_high": 2.5}))
    '3 bouts of late answers, 0.4 to 2.5 times as often as the machine itself'
    >>> bouts(pd.Series({"stalls": 1, "bouts_ratio_low": 0.03, "bouts_ratio_high": math.inf}))
    '1 bout of late answers, whether more often than the machine itself cannot be told'
    """
    low, high = line.bouts_ratio_low, line.bouts_ratio_high
    count = f"{line.stalls:.0f} bout{'' if line.stalls == 1 else 's'} of late answers"
    if not line.stalls:
        return "no bouts of late answers"
    if low <= 1.0 and high > TOLD:
        return f"{count}, whether more often than the machine itself cannot be told"
    return f"{count}, {number(low)} to {number(high)} times as often as the machine itself"


def notes(table: pd.DataFrame, settings: StreamSettings) -> list[str]:
    """The machine's own response times, and the solvers that were stopped."""
    floor, field = table[table.is_floor], table[~table.is_floor]
    stopped = field[field.stopped != ""]
    late = (
        f"Late at each of the first {settings.give_up} samples and stopped there: {len(stopped)} of {len(field)} "
        f"lanes; their median service times are {number(stopped['service_p50_us'].min())} to "
        f"{number(stopped['service_p50_us'].max())} µs."
    )
    return [
        *(
            f"The machine itself, a solver that answers at once on the same schedule, misses {line.missed:.0f} of "
            f"{line.samples} deadlines, in {line.stalls:.0f} stalls, and responds with {_tail(line)}, at most "
            f"{number(line.response_max_us)} µs."
            for _, line in floor.iterrows()
        ),
        *([late] if len(stopped) else []),
    ]


def _staleness(table: pd.DataFrame, settings: StreamSettings) -> list[str]:
    """Cost gaps of the first answer, of the paper's method and of the exact solver."""
    costs = [
        f"{text} is {percent(line.gap_mean)} above the optimal cost on average and {percent(line.gap_max)} at most"
        for text, selected in (
            ("the first answer, if it is kept,", table.is_floor),
            ("the paper's one projected step a sample", (table.solver == PAPER) & (table.settings == ONE_STEP)),
            (f"{marked(EXACT)} with the exact optimum at every sample", table.solver == EXACT),
        )
        for _, line in table[selected & table.gap_mean.notna()].head(1).iterrows()
    ]
    seconds = settings.samples * PERIOD_NS * 1e-9
    return [f"Over {seconds:.3g} s of drift {'; '.join(costs)}."] if costs else []


def _tail(line: pd.Series) -> str:
    """The median response time and its farthest percentile that the sample supports."""
    known = [
        f"{Percentile(q).name} {number(line[column('response', q)])} µs"
        for q in QUANTILES
        if line[column("response", q)] >= 0
    ]
    return " and ".join(known[:1] + known[1:][-1:]) or "too few samples to say"


KIND = Kind("stream", "Stream race", "sample by sample at 8 kHz", StreamSettings, StreamRace, report)
