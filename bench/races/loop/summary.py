"""Numbers and sentences of a closed-loop race: whether the accuracy of the solver changes the tracking error.

A row of the *summary* is one solver with its settings on one stage: the errors of both axes together over the
last window, and the cost gap and time to learn of the worse axis.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from bench.derived.accuracy import least_good, worst
from bench.messages.task import PAPERS_SETTING
from bench.races.chosen_settings import tier_label
from bench.report.words import format_distinct, gap, joined, marked, number, settings_label
from bench.stage.setup import RANGE_UM

NOTICED = 1.1
"""Smallest ratio to the least error that counts as a difference."""
EXACT = 1e-6
"""Largest cost gap of an exact solution."""
GROUP = ["problem", "solver", "lane", "tier", "settings"]


def root_mean_square(values: pd.Series) -> float:
    """RMS error of both axes together."""
    return float(np.sqrt(np.mean(values**2)))


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per stage, solver and settings, by tracking error; failures are left out."""
    last = rows[(rows.window >= 0) & (rows.window == rows.window.max())]
    table = (
        last.groupby(GROUP)
        .agg(
            setting=("setting", "first"),
            basis=("basis", "first"),
            status=("status", least_good),
            rms_percent=("rms_percent", root_mean_square),
            max_percent=("max_percent", "max"),
            rms_um=("rms_um", root_mean_square),
            max_um=("max_um", "max"),
            straight_rms_percent=("straight_rms_percent", root_mean_square),
            hand_overs=("hand_overs", "min"),
            refused=("refused", "max"),
            learn_samples=("learn_samples", worst),
            cost_gap=("cost_gap", worst),
        )
        .reset_index()
    )
    table["label"] = [
        f"{marked(line.solver)}, {settings_label(line.settings) or tier_label(line.tier, line.basis)}"
        for line in table.itertuples()
    ]
    return table.sort_values(["problem", "rms_percent"], ascending=[False, True], ignore_index=True)


def learners(table: pd.DataFrame) -> list[tuple[str, str]]:
    """Label and lane of each learner: the paper's method, then the others by their largest ratio to a stage's least
    error."""
    ratio = table.rms_percent / table.groupby("problem").rms_percent.transform("min")
    by_learner = table.assign(ratio=ratio, paper=table.settings == PAPERS_SETTING).groupby(["label", "lane"])
    order = by_learner.agg(paper=("paper", "any"), ratio=("ratio", "max"))
    return list(order.sort_values(["paper", "ratio"], ascending=[False, True], kind="stable").index)


def verdict(table: pd.DataFrame) -> list[str]:
    """The least tracking error, the accuracy that it needs, and the error of the paper's method."""
    stages = [(problem, part[part.cost_gap.notna()]) for problem, part in table.groupby("problem", sort=False)]
    stages = [(problem, part.reset_index(drop=True)) for problem, part in stages if len(part)]
    if not stages:
        return ["No solver learned weights that the loop used."]
    near, paper, far = [], [], []
    for problem, part in stages:
        inside = part.rms_percent <= NOTICED * part.rms_percent.min()
        near.append(
            f"on the {problem} stage {inside.sum()} of {len(part)} learners are within "
            f"{100 * (NOTICED - 1):.0f} % of the least error, "
            f"{_nm(part.rms_um[0])} nm RMS, with cost gaps up to {gap(part[inside].cost_gap.max())} (a "
            f"straight line in place of a model leaves {_nm(part.straight_rms_percent[0] / 100.0 * RANGE_UM)} nm)"
        )
        paper += [
            f"{_nm(line.rms_um)} nm on the {problem} stage, {number(line.rms_percent / part.rms_percent.min())} "
            f"times the least, at a cost gap of {gap(line.cost_gap)}"
            for _, line in part[part.settings == PAPERS_SETTING].iterrows()
        ]
        if not inside.all():
            far.append(f"{gap(part[~inside].cost_gap.min())} on the {problem} stage")
    sentence = "; ".join(near)
    return [
        f"{sentence[0].upper()}{sentence[1:]}.",
        *([f"The paper's method with its 15 200 steps reaches {'; '.join(paper)}."] if paper else []),
        *([f"Learners farther away have cost gaps of at least {joined(far)}."] if far else []),
    ]


def notes(table: pd.DataFrame) -> Iterator[str]:
    """Errors and times to learn of the exact learners that were refused no more often than the best one."""
    for problem, part in table.groupby("problem", sort=False):
        learned = part[part.cost_gap.notna()]
        exact = learned[(learned.cost_gap <= EXACT) & (learned.refused <= learned.refused.head(1).max())]
        if len(exact) > 1:
            least, most = format_distinct(1e3 * exact.rms_um.min(), 1e3 * exact.rms_um.max())
            yield (
                f"On the {problem} stage the {len(exact)} learners with a cost gap of at most {EXACT:g} leave "
                + (f"{least} nm" if least == most else f"{least} to {most} nm")
                + f" and take {exact.learn_samples.min():.0f} to {exact.learn_samples.max():.0f} samples to learn."
            )


def _nm(um: float) -> str:
    return number(1e3 * um)


def closed_loop(table: pd.DataFrame) -> pd.DataFrame:
    """Tracking error and cost gap of the weights in use, one row per stage and learner."""
    table = table[table.cost_gap.notna()]
    return (
        table.assign(front=table.settings == PAPERS_SETTING)
        .rename(columns={"label": "name"})[
            [
                "problem",
                "name",
                "solver",
                "lane",
                "settings",
                "cost_gap",
                "rms_percent",
                "straight_rms_percent",
                "learn_samples",
                "front",
            ]
        ]
        .reset_index(drop=True)
    )
