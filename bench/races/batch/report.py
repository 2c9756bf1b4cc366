"""What a batch race says and shows."""

import pandas as pd

from bench.races.batch import figures
from bench.races.batch.race import BATCH, SHARES, BatchSettings
from bench.races.settings import settings_of
from bench.report.plot import Axis, Plot, best_lines
from bench.report.report import Figure, Report, Table
from bench.report.words import OURS_NOTE, gap, number, share
from bench.store import Run
from solvers import Status

WRONG = ("d", "contestant", "lane", "threads", "batch", "status", "message")


def definitions(settings: BatchSettings) -> tuple[str, ...]:
    """What the words mean."""
    return (
        "A program is ½ xᵀP x + qᵀx over lb ≤ x: a mixture of four windows of a recording of a simulated actuator, "
        "seen by a model of d unknowns. No two programs are alike; active sets, conditions (1e4 to 1e11) and bounds "
        "differ within a batch.",
        "Kernel: a batch is one call of compiled code. Direct: a loop in Python over the library's own call for one "
        "program. Whatever a batch needs, such as putting programs side by side, is in its time; compiling for its "
        "size is not.",
        "A second and core: programs by the processor time that the process took, all its threads together, the "
        "median of groups of calls of at least a millisecond where a batch is quicker than that. A second: by the "
        "clock. The answers are copied inside the time.",
        f"Right to 1e-9: of up to {settings.judged} answers of each timed batch, which the contestant cannot know, "
        "the share whose relative cost gap and violation are at most 1e-9, against optima that are proven in exact "
        "arithmetic.",
        "GB/s: the bytes of P, q, lb, ub and x, which any solver has to read and write once, by the clock; what a "
        "solver moves beside is its own. Memory: by how much the process's largest resident memory grew over what it "
        "had before the calls.",
        "One thread stands on one core; several are free to use all cores.",
        OURS_NOTE,
    )


def report(run: Run) -> Report:
    """Everything from the rows of a finished run."""
    settings = settings_of(run, BatchSettings)
    table = figures.summary(run.rows(BATCH))
    first = table.drop_duplicates([*figures.ID_COLUMNS, "status", "message"])
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
        figures.verdict(table),
        ranking(table, settings),
        table.drop(columns="label"),
        definitions=definitions(settings),
        tables=[
            *(_by_batch(part, settings) for _, part in table.groupby("d")),
            _at_best(table),
            Table("What was missed and what was not run", WRONG, wrong, 7, ("d", "contestant", "threads", "status")),
        ],
        figures=[
            Figure(
                "batch",
                "Programs a second and core by batch size",
                "Programs a second and core against how many are handed over at once; higher is better.",
                figures.by_batch(table),
                [
                    Plot(
                        Axis("batch", "programs in a batch", log=True),
                        Axis("core_rate", "programs a second and core", log=True),
                        best_lines(points=True),
                        ("name", "batch", "core_rate", "rate", "share_high", "gb_s"),
                    )
                ],
            )
        ],
    )


def ranking(table: pd.DataFrame, settings: BatchSettings) -> Table:
    """Each contestant with one thread at the batch size that suits it best, one column a size of program."""
    lines = figures.best(table[table.threads == 1])
    by_who = {
        key: {line.d: line for _, line in part.iterrows()} for key, part in lines.groupby(["label", "lane"], sort=False)
    }
    rows = [
        [*map(str, key), *(cell for d in settings.sizes for cell in _at(found.get(d)))] for key, found in by_who.items()
    ]
    headings = (
        "contestant",
        "lane",
        *(f"{what}, d = {d}" for d in settings.sizes for what in ("thousand/s", "1e-9", "GB/s")),
    )
    return Table(
        "Programs a second and core",
        headings,
        rows,
        2,
        ("lane",),
        "Thousands of programs a second on one core, at the batch size that suits each best; the share of judged "
        f"answers right to 1e-9; data and answers moved. {OURS_NOTE}",
    )


def _at(line: pd.Series | None) -> tuple[str, str, str]:
    return (
        ("–", "–", "–") if line is None else (number(line.core_rate / 1e3), share(line.share_high), number(line.gb_s))
    )


def _by_batch(part: pd.DataFrame, settings: BatchSettings) -> Table:
    """Core rates of one size of program by batch size, the fastest first."""
    rows = []
    for _, line in figures.best(part).iterrows():
        rates = part[(part[figures.ID_COLUMNS] == line[figures.ID_COLUMNS]).all(axis=1)].set_index("batch").core_rate
        rows.append(
            [
                line.label,
                line.lane,
                str(line.threads),
                *(number(float(rates[batch]) / 1e3) for batch in settings.batches),
            ]
        )
    return Table(
        f"Thousands of programs a second and core, by batch size, d = {part.d.iloc[0]}",
        ("contestant", "lane", "threads", *map(str, settings.batches)),
        rows,
        2,
        ("lane", "threads"),
    )


def _at_best(table: pd.DataFrame) -> Table:
    """Everything about each contestant at the batch size that suits it best."""
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
        for _, line in figures.best(table).iterrows()
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
        "and core",
        "cores busy",
        "bytes",
        "GB/s",
        "memory, MB",
    )
    return Table("At the batch size that suits each best", headings, rows, 3, ("d", "lane", "threads"))
