"""Numbers and sentences of a batch race; `report` renders them.

A row of the *summary* is one contestant with a number of threads at one batch size, over its repeats. Programs
per second come from wall time; programs per second and core from CPU time, on which other load of the machine has far
less influence:

    rate = 1 / wall time of a program,   core rate = 1 / CPU time of a program,   both medians over the groups of calls
    and over the repeats, GB/s = rate × (8 (d² + 4 d) bytes of P, q, lb, ub and x).
"""

import numpy as np
import pandas as pd

from bench.derived.accuracy import least_good
from bench.derived.pictures import ranked
from bench.races.batch.race import SHARES
from bench.report.words import joined, marked, number
from solvers.registry import OURS

GROUP = ["d", "solver", "lane", "threads", "batch"]
ID_COLUMNS = ["d", "solver", "lane", "threads"]


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per contestant, number of threads and batch size."""
    judged = rows.judged.to_numpy()
    table = (
        rows.assign(**{share: rows[share] * judged for share in SHARES})
        .groupby(GROUP, sort=False)
        .agg(
            status=("status", least_good),
            message=("message", "max"),
            programs=("programs", "sum"),
            judged=("judged", "sum"),
            **{share: (share, "sum") for share in SHARES},
            worst_gap=("worst_gap", "max"),
            wall_us_p50=("wall_us_p50", "median"),
            cpu_us_p50=("cpu_us_p50", "median"),
            bytes=("bytes", "first"),
            grown_mb=("grown_mb", "max"),
        )
        .reset_index()
    )
    for share in SHARES:
        table[share] = table[share] / table.judged.where(table.judged > 0)
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
                f"At d = {d} {first.label} solves {thousands(first.core_rate)} programs a second and core, each of "
                f"{judged} judged answers right to 1e-9: {compared} as {other.label}, the "
                f"best other with equally accurate answers, with {thousands(other.core_rate)}."
            )
        elif len(part):
            sentences.append(
                f"At d = {d} {part.iloc[0].label} solves {thousands(part.iloc[0].core_rate)} programs a "
                "second and core, right to 1e-9."
            )
    several = best(right[(right.threads > 1) & right.ours], "rate").drop_duplicates("d")
    if len(several):
        rates = joined(f"{thousands(line.rate)} a second at d = {line.d}" for _, line in several.iterrows())
        sentences.append(
            f"With a thread on each of {several.threads.iloc[0]} cores {several.label.iloc[0]} solves {rates}."
        )
    return sentences or ["No contestant has answers that are right to 1e-9."]


def thousands(rate: float) -> str:
    """A rate in a sentence, to three digits.

    Examples
    --------
    >>> thousands(1_053_211.0), thousands(48_512.3)
    ('1,050,000', '48,500')
    """
    return f"{float(f'{rate:.3g}'):,.0f}"


def by_batch(table: pd.DataFrame) -> pd.DataFrame:
    """Core rate against batch size, one row per line and size; the name of a line has the number of threads if that is
    not one."""
    shown = table[np.isfinite(table.core_rate)]
    name = shown.label + np.where(shown.threads > 1, ", " + shown.threads.astype(str) + " threads", "")
    table = ranked(shown.assign(name=name, view="d = " + shown.d.astype(str)), -shown.core_rate)
    return table[
        ["view", "name", "solver", "lane", "threads", "batch", "core_rate", "rate", "share_high", "gb_s", "front"]
    ]
