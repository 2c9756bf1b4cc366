"""The report of a stream race."""

import json
import math
from collections.abc import Callable, Iterable, Sequence

import pandas as pd

from bench.messages.task import PAPER
from bench.races.chosen_settings import definition, tier_label
from bench.races.settings import settings_of
from bench.races.stream import plot_data, summary
from bench.races.stream.race import STREAM, StreamSettings
from bench.report.plot import Axis, Plot, best_lines
from bench.report.report import Figure, Report, Table, what_went_wrong
from bench.report.words import OURS_NOTE, gap, marked, number, settings_label, share
from bench.store import Run
from bench.timing.percentiles import QUANTILES, Percentile, needed
from bench.timing.schedule import PERIOD_US

NAMES = ("solver", "lane", "tier", "settings")
QUANTILE_NAMES = tuple(Percentile(q).name for q in QUANTILES)


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
        "optimal cost: in doubles at all samples, against box_active_set, and exact at "
        f"{settings.certified} instants with proven optima. Own answers: the largest gap of an answer at "
        "its own sample. Reused: samples at whose deadline an older answer was in use.",
        "The compiled loops process the same rows back to back, forwards and backwards: no waiting, hot caches, no "
        "response times. Corrected: each call longer than the period also counts for the samples that would have "
        "waited behind it on a schedule.",
        f"A lane whose answers to the first {settings.give_up} samples are all late is stopped there. Every lane "
        "runs in a fresh process after an untimed warm-up on the same rows, without garbage collection, on one thread "
        "and one core.",
        definition(settings.settings_run),
        OURS_NOTE,
    )


def report(run: Run) -> Report:
    """The report of a finished run."""
    rows, times = run.rows(STREAM), run.times()
    table = summary.summary(rows, times)
    lines = plot_data.lines(table, rows, times)
    shown = [
        Figure(
            "latency_tails",
            "Latency tails",
            "Response time by percentile, as far as the number of samples supports it; lower is better, and above the "
            f"dashed line the deadline is missed. In colour: {plot_data.FLOOR_NAME}, a solver that answers at once, "
            "and the lanes with the lowest p99. Compiled loops have no schedule and are drawn by their service time.",
            plot_data.latency_tails(lines),
            [
                Plot(
                    Axis(
                        "one_in",
                        "percentile of the samples",
                        log=True,
                        values=[10.0**k for k in range(1, 7)],
                        label="'p' + format(100 * (1 - 1 / datum.value), '.6~f')",
                    ),
                    Axis("us", "response time, µs (compiled loops: service time)", log=True),
                    best_lines(),
                    rules={"y": PERIOD_US},
                )
            ],
        ),
        Figure(
            "deadline_profile",
            "Deadline profile",
            "Share of samples answered within k sampling periods of their due time. The deadline is one period.",
            plot_data.deadline_profile(lines),
            [
                Plot(
                    Axis("periods", f"k: periods of {PERIOD_US:g} µs after the due time", log=True),
                    Axis("share", "share of samples answered within k periods", percent=True, domain=(0.0, 1.0)),
                    best_lines("step"),
                )
            ],
        ),
    ]
    return report_of(table, settings_of(run, StreamSettings), shown)


def report_of(table: pd.DataFrame, settings: StreamSettings, shown: Sequence[Figure] = ()) -> Report:
    """The report of a summary, the settings of the race and its figures."""
    paced, kernel = ([line for _, line in part.iterrows()] for part in (table[table.paced], table[~table.paced]))
    tables = [
        _table(
            "Response time on the schedule, µs: due time to answer",
            (*QUANTILE_NAMES, "max", "missed", "bouts", "times the machine's", "status"),
            paced,
            lambda line: [
                *_percentiles(line, "response"),
                f"{line.missed}/{line.samples}",
                str(line.stalls),
                "–" if line.is_floor else f"{number(line.bouts_ratio_low)} to {number(line.bouts_ratio_high)}",
                line.status,
            ],
        ),
        _table(
            "Service time on the schedule, µs: begin to answer",
            (*QUANTILE_NAMES, "max", "update p50", "solve p50", "solves", "stopped"),
            paced,
            lambda line: [
                *_percentiles(line, "service"),
                number(line.update_us_p50),
                number(line.solve_us_p50),
                str(line.solves),
                line.stopped,
            ],
        ),
        _table(
            "Relative cost gap of the answer in use",
            ("mean", "max", "exact mean", "exact max", "own answers", "reused", "unanswered"),
            paced + kernel,
            lambda line: [
                gap(line.gap_mean),
                gap(line.gap_max),
                gap(line.exact_gap_mean),
                gap(line.exact_gap_max),
                gap(line.own_gap_max),
                share(line.reused),
                str(line.unanswered),
            ],
        ),
        _table(
            "Service time in compiled loops, µs, back to back and not paced",
            (*QUANTILE_NAMES, "max", f"{QUANTILE_NAMES[-1]} corrected", "rows", "stopped", "status"),
            kernel,
            lambda line: [
                *_percentiles(line, "service"),
                _or_needs(line[summary.CORRECTED], summary.FARTHEST),
                str(line.samples),
                line.stopped,
                line.status,
            ],
        ),
    ]
    return Report(
        summary.verdict(table, settings),
        ranking(table),
        table,
        figures=shown,
        notes=summary.notes(table, settings),
        tables=[*tables, what_went_wrong(table, (*NAMES, "status", "message"), NAMES)],
        definitions=definitions(settings),
        limits=["The operating system is not a real-time one."],
    )


def ranking(table: pd.DataFrame) -> Table:
    """Table of the solvers that keep the schedule; the paper's method first, then the floor."""
    paper = (table.solver == PAPER) & (table.settings == json.dumps({"steps": 1}))
    tail = max((q for q in QUANTILES if table[summary.column("response", q)].notna().any()), default=QUANTILES[0])
    rows = [
        [
            marked(line.solver),
            line.lane,
            settings_label(str(line.settings)) or tier_label(line.tier, line.basis),
            _schedule(line),
            *(number(line[summary.column("response" if line.paced else "service", q)]) for q in (QUANTILES[0], tail)),
            share(line.missed / line.samples if line.samples else math.nan),
            gap(line.gap_mean),
            gap(line.gap_max),
        ]
        for _, line in pd.concat([table[paper], table[~paper]]).iterrows()
    ]
    headings = (
        "solver",
        "lane",
        "setting",
        "schedule",
        "p50, µs",
        f"{Percentile(tail).name}, µs",
        "missed",
        "mean gap",
        "worst gap",
    )
    return Table(
        "Who keeps the schedule",
        headings,
        rows,
        3,
        ("lane", "schedule"),
        "Response time by percentile; for compiled loops the time of a row. Missed: answers later than "
        f"{PERIOD_US:g} µs. Gap: the cost of the answer in use above the optimum of its sample, over that optimum. "
        f"{OURS_NOTE}",
    )


def _schedule(line: pd.Series) -> str:
    """Whether a solver keeps the schedule, in one word."""
    if not line.paced or line.is_floor:
        return "floor" if line.paced else "loop"
    if line.keeps_up:
        return "kept"
    return str(line.status) if line.machine_keeps or line.status in summary.FAILURES else "unknown"


def _table(
    title: str,
    headings: Sequence[str],
    lines: Iterable[pd.Series],
    cells: Callable[[pd.Series], Sequence[str]],
) -> Table:
    """A table of solver lanes."""
    rows = [
        [
            marked(line.solver),
            line.lane,
            tier_label(line.tier, line.basis),
            settings_label(str(line.settings)),
            *cells(line),
        ]
        for line in lines
    ]
    return Table(title, (*NAMES, *headings), rows, len(NAMES))


def _percentiles(line: pd.Series, kind: str) -> list[str]:
    """All percentiles of a kind and the maximum."""
    return [*(_percentile(line, kind, q) for q in QUANTILES), number(line[f"{kind}_max_us"])]


def _percentile(line: pd.Series, kind: str, q: float) -> str:
    """Value and interval, marked if it is not above the machine's floor; or the number of samples that it needs."""
    value, low, high = (line[summary.column(kind, q, end)] for end in ("", "low", "high"))
    interval = "" if math.isnan(value) else f" ({number(low)} to {number(high)})"
    at_floor = kind == "response" and not line.is_floor and line[f"at_floor_{Percentile(q).name}"]
    return _or_needs(value, q) + interval + (" ≈ floor" if at_floor else "")


def _or_needs(value: float, q: float) -> str:
    """A percentile, or the number of samples that it needs."""
    return f"needs {needed(q)}" if math.isnan(value) else number(value)
