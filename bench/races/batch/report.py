"""The report of a batch race.

Programs per second come from wall time; programs per second and core from CPU time, on which other load of the machine
has far less influence:

    rate = 1 / wall time of a program,   core rate = 1 / CPU time of a program,   both medians over the groups of calls
    and over the repeats, GB/s = rate × (8 (d² + 4 d) bytes of P, q, lb, ub and x).
"""

import numpy as np
import pandas as pd

from bench.derived.pictures import ranked
from bench.messages.columns import Column, combined
from bench.messages.task import Status
from bench.races.batch.race import BATCH, SHARES, BatchRace, BatchSettings
from bench.races.kind import Kind
from bench.report.report import Axis, Figure, Plot, Report, Table, best_lines, side_by_side
from bench.report.words import OURS_NOTE, gap, joined, marked, number, share, thousand
from bench.store import Run
from solvers.registry import OURS

ID_COLUMNS = ["d", "solver", "lane", "threads"]
WRONG = (
    *(column for column in BATCH.columns if column.name in ("d", "label", "lane", "threads", "batch")),
    Column("status", heading="status"),
    Column("message", heading="message"),
)


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
        "memory traffic.",
        "One thread is pinned to one core; several threads may use all cores.",
        OURS_NOTE,
    )


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per contestant, number of threads and batch size."""
    judged = rows.assign(**{name: rows[name] * rows.judged for name in SHARES})
    table = combined(judged, BATCH.columns, [*ID_COLUMNS, "batch"])
    for name in SHARES:
        table[name] /= table.judged.where(table.judged > 0)
    table["label"], table["ours"] = table.solver.map(marked), table.solver.isin(OURS)
    table["rate"], table["core_rate"] = 1e6 / table.wall_us_p50, 1e6 / table.cpu_us_p50
    table["gb_s"], table["cores_busy"] = 1e-9 * table.rate * table.bytes, table.cpu_us_p50 / table.wall_us_p50
    return table


def best(table: pd.DataFrame, rate: str = "core_rate") -> pd.DataFrame:
    """The fastest batch size of each contestant and number of threads; fastest contestants first, those without a time
    last."""
    order = table.sort_values(["d", rate], ascending=[True, False], na_position="last")
    return order.drop_duplicates(ID_COLUMNS).reset_index(drop=True)


def everywhere_right(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the contestants whose judged answers are all right to 1e-9, at every batch size that was run."""
    return table[table.groupby(ID_COLUMNS).share_high.transform("min") == 1.0]  # NaN if none was judged


def verdict(table: pd.DataFrame) -> list[str]:
    """Our rate beside the best other contestant that is equally accurate, and the rate with all cores."""
    right = everywhere_right(table)
    sentences = []
    for d, part in best(right[right.threads == 1]).groupby("d"):
        ours, others = part[part.ours], part[~part.ours]
        if len(ours) and len(others):
            first, other = ours.iloc[0], others.iloc[0]
            judged = table[(table[ID_COLUMNS] == first[ID_COLUMNS]).all(axis=1)].judged.sum()
            times = first.core_rate / other.core_rate
            compared = f"{number(times)} times as many" if times >= 1.0 else f"{number(100.0 * times)} % as many"
            sentences.append(
                f"At d = {d} {first.label} solves {_rounded(first.core_rate)} programs a second and core, each of "
                f"{judged} judged answers right to 1e-9: {compared} as {other.label}, the "
                f"best other with equally accurate answers, with {_rounded(other.core_rate)}."
            )
        elif len(part):
            sentences.append(
                f"At d = {d} {part.iloc[0].label} solves {_rounded(part.iloc[0].core_rate)} programs a "
                "second and core, right to 1e-9."
            )
    several = best(right[(right.threads > 1) & right.ours], "rate").drop_duplicates("d")
    if len(several):
        rates = joined(f"{_rounded(line.rate)} a second at d = {line.d}" for _, line in several.iterrows())
        sentences.append(
            f"With a thread on each of {several.threads.iloc[0]} cores {several.label.iloc[0]} solves {rates}."
        )
    return sentences or ["No contestant has answers that are right to 1e-9."]


def _rounded(rate: float) -> str:
    """A rate in a sentence, to three digits."""
    return f"{float(f'{rate:.3g}'):,.0f}"


def report(run: Run, settings: BatchSettings) -> Report:
    """The report of a finished run."""
    table = summary(run.rows(BATCH))
    wrong = table[table.status != Status.OK].drop_duplicates([*ID_COLUMNS, "status", "message"])
    messages = [line.message or f"worst {gap(line.worst_gap)}" for _, line in wrong.iterrows()]
    name = table.label + np.where(table.threads > 1, ", " + table.threads.astype(str) + " threads", "")
    lines = table.assign(name=name, view="d = " + table.d.astype(str))[np.isfinite(table.core_rate)]
    return Report(
        verdict(table),
        ranking(table),
        table.drop(columns="label"),
        definitions=definitions(settings),
        tables=[
            *(_by_batch(d, part) for d, part in table.groupby("d")),
            Table.of(
                "At the fastest batch size of each contestant",
                best(table),
                BATCH.columns,
                3,
                filters=("d", "lane", "threads"),
            ),
            Table.of(
                "Missed and skipped batches",
                wrong.assign(message=messages),
                WRONG,
                7,
                filters=("d", "contestant", "threads", "status"),
            ),
        ],
        figures=[
            Figure(
                "batch",
                "Programs per second and core by batch size",
                "Programs per second and core against the number of programs in a call; higher is better.",
                ranked(lines, -lines.core_rate),
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


def ranking(table: pd.DataFrame) -> Table:
    """Each contestant with one thread at its best batch size; three columns per size of program."""
    fastest = best(table[table.threads == 1])
    shown = (
        Column("core_rate", heading="thousand/s, d = {}", format=thousand),
        Column("share_high", heading="1e-9, d = {}", format=share),
        Column("gb_s", heading="GB/s, d = {}", format=number),
    )
    lines, wide = side_by_side(fastest[["label", "lane"]].drop_duplicates(), fastest, "d", shown)
    return Table.of(
        "Programs per second and core",
        lines,
        (Column("label", heading="contestant"), Column("lane", heading="lane"), *wide),
        2,
        filters=("lane",),
        note="Thousands of programs per second on one core, at the fastest batch size of each contestant; the share of "
        f"judged answers right to 1e-9; data and answers moved. {OURS_NOTE}",
    )


def _by_batch(d: object, part: pd.DataFrame) -> Table:
    """Core rates for one size of program by batch size, fastest first."""
    rates = part.pivot(index=ID_COLUMNS, columns="batch", values="core_rate")
    return Table.of(
        f"Thousands of programs per second and core, by batch size, d = {d}",
        best(part)[[*ID_COLUMNS, "label"]].join(rates, on=ID_COLUMNS),
        (
            Column("label", heading="contestant"),
            Column("lane", heading="lane"),
            Column("threads", heading="threads"),
            *(Column(batch, heading=str(batch), format=thousand) for batch in rates.columns),
        ),
        2,
        filters=("lane", "threads"),
    )


KIND = Kind("batch", "Batch race", "many programs at once", BatchSettings, BatchRace, report)
