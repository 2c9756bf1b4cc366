"""Every figure of a batch race, computed here once and rendered elsewhere.

A *summary* row stands for one contestant with a number of threads at one batch size, over its turns. Programs a second
are by the clock; programs a second and core by what the process took of the processors, which other work on the machine
lengthens far less:

    rate = 1 / clock time of a program,   core rate = 1 / processor time of a program,   both medians of the groups of
    calls and of the turns, GB/s = rate × (8 (d² + 4 d) bytes of P, q, lb, ub and x).
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
    """One row a contestant, number of threads and batch size."""
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
    """Of each contestant with a number of threads the batch size that suits it best, the fastest first; those without a
    time last."""
    order = table.sort_values(["d", rate], ascending=[True, False], na_position="last")
    return order.drop_duplicates(ID_COLUMNS).reset_index(drop=True)


def everywhere_right(table: pd.DataFrame) -> pd.DataFrame:
    """Of a summary those of whom every judged answer at every batch size that was run is right to 1e-9."""
    right = table.assign(right=(table.share_high == 1.0) | (table.judged == 0), some=table.judged > 0).groupby(
        ID_COLUMNS
    )[["right", "some"]]
    kept = right.agg(right=("right", "all"), some=("some", "any")).all(axis=1)
    return table[[kept.loc[tuple(line)] for line in table[ID_COLUMNS].itertuples(index=False)]]


def verdict(table: pd.DataFrame) -> list[str]:
    """Say how fast ours is beside the next who is as right, and what all cores do."""
    right = everywhere_right(table)
    sentences = []
    for d, part in best(right[right.threads == 1]).groupby("d"):
        ours, others = part[part.ours], part[~part.ours]
        if len(ours) and len(others):
            first, after = ours.iloc[0], others.iloc[0]
            times = first.core_rate / after.core_rate
            compared = f"{number(times)} times as many" if times >= 1.0 else f"{number(100.0 * times)} % as many"
            sentences.append(
                f"At d = {d} {first.label} solves {thousands(first.core_rate)} programs a second and core, each of "
                f"{judged(table, first)} judged answers right to 1e-9: {compared} as {after.label}, the "
                f"next that is as right, with {thousands(after.core_rate)}."
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


def judged(table: pd.DataFrame, line: pd.Series) -> int:
    """How many answers of a contestant were judged."""
    return int(table.loc[np.logical_and.reduce([table[name] == line[name] for name in ID_COLUMNS]), "judged"].sum())


def thousands(rate: float) -> str:
    """A rate in a sentence.

    Examples
    --------
    >>> thousands(1_053_211.0), thousands(48_512.3)
    ('1,050,000', '48,500')
    """
    return f"{float(f'{rate:.3g}'):,.0f}"


def by_batch(table: pd.DataFrame) -> pd.DataFrame:
    """Core rate against batch size, one row a line and size; a line has the number of its threads where that is not
    one."""
    shown = table[np.isfinite(table.core_rate)]
    name = shown.label + np.where(shown.threads > 1, ", " + shown.threads.astype(str) + " threads", "")
    table = ranked(shown.assign(name=name, view="d = " + shown.d.astype(str)), -shown.core_rate)
    return table[
        ["view", "name", "solver", "lane", "threads", "batch", "core_rate", "rate", "share_high", "gb_s", "front"]
    ]
