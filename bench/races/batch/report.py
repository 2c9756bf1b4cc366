"""The report of a batch race."""

import pandas as pd

from bench.messages.verdict import Status
from bench.races.batch import summary
from bench.races.batch.race import BATCH, SHARES, BatchSettings
from bench.races.settings import settings_of
from bench.report.plot import Axis, Plot, best_lines
from bench.report.report import Figure, Report, Table
from bench.report.words import OURS_NOTE, gap, number, share
from bench.store import Run

WRONG = ("d", "contestant", "lane", "threads", "batch", "status", "message")


def definitions(settings: BatchSettings) -> tuple[str, ...]:
    """Definitions of the terms."""
    return (
        "A program is ½ xᵀP x + qᵀx over lb ≤ x: a mixture of four windows of a recording of a simulated actuator, "
        "identified with a model of d unknowns. No two programs are alike; active sets, condition numbers (1e4 to "
        "1e11) and bounds differ within a batch.",
        "Kernel: a batch is one call of compiled code. Direct: a Python loop over the library's own call for one "
        "program. All work on a batch, such as interleaving its programs, is timed; compiling for its size is not.",
        "Per second and core: programs by the CPU time of all threads of the process, the median over groups of calls "
        "that last at least a millisecond. Per second: by wall time. Copying the answers is timed.",
        f"Right to 1e-9: the share of up to {settings.judged} answers of each task, unknown to the contestant, whose "
        "relative cost gap and violation are at most 1e-9, against optima proven in exact arithmetic.",
        "GB/s: P, q, lb, ub and x, which any solver has to read or write once, by wall time, without the solver's own "
        "memory traffic. Memory: growth of the peak resident memory of the process during the calls.",
        "One thread is pinned to one core; several threads may use all cores.",
        OURS_NOTE,
    )


def report(run: Run) -> Report:
    """The report of a finished run."""
    settings = settings_of(run, BatchSettings)
    table = summary.summary(run.rows(BATCH))
    first = table.drop_duplicates([*summary.ID_COLUMNS, "status", "message"])
    wrong = [
        [
            str(line.d),
            line.label,
            line.lane,
            str(line.threads),
            str(line.batch),
            line.status,
            line.message or f"worst {gap(line.worst_gap)}",
        ]
        for _, line in first[first.status != Status.OK].iterrows()
    ]
    return Report(
        summary.verdict(table),
        ranking(table, settings),
        table.drop(columns="label"),
        definitions=definitions(settings),
        tables=[
            *(_by_batch(part, settings) for _, part in table.groupby("d")),
            _at_best(table),
            Table("Missed and skipped batches", WRONG, wrong, 7, ("d", "contestant", "threads", "status")),
        ],
        figures=[
            Figure(
                "batch",
                "Programs per second and core by batch size",
                "Programs per second and core against the number of programs in a call; higher is better.",
                summary.by_batch(table),
                [
                    Plot(
                        Axis("batch", "programs in a batch", log=True),
                        Axis("core_rate", "programs per second and core", log=True),
                        best_lines(points=True),
                        ("name", "batch", "core_rate", "rate", "share_high", "gb_s"),
                    )
                ],
            )
        ],
    )


def ranking(table: pd.DataFrame, settings: BatchSettings) -> Table:
    """Each contestant with one thread at its best batch size; three columns per size of program."""
    best = summary.best(table[table.threads == 1])
    rows = []
    for key, part in best.groupby(["label", "lane"], sort=False):
        by_size = {line.d: line for _, line in part.iterrows()}
        rows.append([*map(str, key), *(cell for d in settings.sizes for cell in _cells(by_size.get(d)))])
    headings = (
        "contestant",
        "lane",
        *(f"{what}, d = {d}" for d in settings.sizes for what in ("thousand/s", "1e-9", "GB/s")),
    )
    return Table(
        "Programs per second and core",
        headings,
        rows,
        2,
        ("lane",),
        "Thousands of programs per second on one core, at the fastest batch size of each contestant; the share of "
        f"judged answers right to 1e-9; data and answers moved. {OURS_NOTE}",
    )


def _cells(line: pd.Series | None) -> tuple[str, str, str]:
    """The three cells of a contestant for one size of program."""
    if line is None:
        return "–", "–", "–"
    return number(line.core_rate / 1e3), share(line.share_high), number(line.gb_s)


def _by_batch(part: pd.DataFrame, settings: BatchSettings) -> Table:
    """Core rates for one size of program by batch size, fastest first."""
    rows = []
    for _, line in summary.best(part).iterrows():
        rates = part[(part[summary.ID_COLUMNS] == line[summary.ID_COLUMNS]).all(axis=1)].set_index("batch").core_rate
        rows.append(
            [
                line.label,
                line.lane,
                str(line.threads),
                *(number(float(rates[batch]) / 1e3) for batch in settings.batches),
            ]
        )
    return Table(
        f"Thousands of programs per second and core, by batch size, d = {part.d.iloc[0]}",
        ("contestant", "lane", "threads", *map(str, settings.batches)),
        rows,
        2,
        ("lane", "threads"),
    )


def _at_best(table: pd.DataFrame) -> Table:
    """All numbers of each contestant at its fastest batch size."""
    rows = [
        [
            str(line.d),
            line.label,
            line.lane,
            str(line.threads),
            str(line.batch),
            *(share(line[name]) for name in SHARES[::-1]),
            gap(line.worst_gap),
            number(line.rate / 1e3),
            number(line.core_rate / 1e3),
            number(line.cores_busy),
            str(line.bytes),
            number(line.gb_s),
            number(line.grown_mb),
        ]
        for _, line in summary.best(table).iterrows()
    ]
    headings = (
        "d",
        "contestant",
        "lane",
        "threads",
        "batch",
        "1e-9",
        "1e-6",
        "1e-3",
        "worst gap",
        "thousand/s",
        "per core",
        "cores busy",
        "bytes",
        "GB/s",
        "memory, MB",
    )
    return Table("At the fastest batch size of each contestant", headings, rows, 3, ("d", "lane", "threads"))
