"""Every figure of a closed-loop race, computed here once and rendered elsewhere: whether the stage notices how exact its solver is.

A *summary* row stands for one solver with its settings on one stage: errors of both axes together over the last window, and
the worse axis for cost gap, time to learn and staleness.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from bench.report.markdown import settings_label
from bench.rig.rig import RANGE_UM
from solvers import Status

NOTICED = 1.1
"""The stage notices where its error is more than 10 % above the least."""
EXACT = 1e-6
"""Cost gaps up to this are called exact."""
NAMED = 6
"""Solvers that a sentence names."""
GROUP = ["problem", "solver", "lane", "tier", "settings"]


def root_mean_square(values: pd.Series) -> float:
    """Axes taken together."""
    return float(np.sqrt(np.mean(values**2)))


def worst(values: pd.Series) -> float:
    """The largest, NaN where any is."""
    return float(values.max(skipna=False))


def least_good(values: pd.Series) -> str:
    """Ok where all are, else the first that is not."""
    return next((str(value) for value in values if value != Status.OK), str(Status.OK))


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row a stage, solver and settings; the nearest to the reference first, those that failed left out."""
    last = rows[(rows.window >= 0) & (rows.window == rows.window.max())]
    table = last.groupby(GROUP).agg(
        status=("status", least_good), rms_percent=("rms_percent", root_mean_square), max_percent=("max_percent", "max"),
        straight_rms_percent=("straight_rms_percent", root_mean_square), hand_overs=("hand_overs", "min"),
        refused=("refused", "max"), learn_samples=("learn_samples", worst), stale_samples=("stale_samples", worst),
        cost_gap=("cost_gap", worst)).reset_index()
    table["rms_um"] = table.rms_percent / 100.0 * RANGE_UM
    table["max_um"] = table.max_percent / 100.0 * RANGE_UM
    table["who"] = [f"{line.solver}, {settings_label(line.settings) or line.tier}" for line in table.itertuples()]
    return table.sort_values(["problem", "rms_percent"], ascending=[False, True], ignore_index=True)


def verdict(table: pd.DataFrame) -> Iterator[str]:
    """Say from which accuracy on the stage does not notice the solver any more."""
    for problem, part in table.groupby("problem", sort=False):
        learned = part[part.cost_gap.notna()]
        if learned.empty:
            yield f"On the {problem} stage nobody learned anything that was taken over."
            continue
        best = learned.iloc[0]
        near = learned.rms_percent <= NOTICED * best.rms_percent
        yield (f"On the {problem} stage the least error is {best.rms_percent:.3f} % RMS of range ({1e3 * best.rms_um:.0f} nm), that "
               f"of {best.who}, where a straight line in place of a model leaves {best.straight_rms_percent:.2f} %; {near.sum()} of "
               f"{len(part)} learners are within 10 % of it, with cost gaps up to {learned[near].cost_gap.max():.1e}.")
        often = learned.refused > best.refused
        if (refused := learned[~near & often]).size:
            yield (f"Farther away, since more of the answers were refused ({refused.refused.max()} where the best had "
                   f"{best.refused}): {_names(refused)}.")
        if (far := learned[~near & ~often]).size:
            yield (f"Farther away, with errors up to {far.rms_percent.max():.3f} % and cost gaps from {far.cost_gap.min():.1e} on: "
                   f"{_names(far)}.")
        exact = learned[(learned.cost_gap <= EXACT) & ~often]
        if len(exact) > 1:
            least, most = (f"{value:.4f} %" for value in (exact.rms_percent.min(), exact.rms_percent.max()))
            yield (f"The {len(exact)} with a gap of at most {EXACT:g} and no more refusals "
                   + (f"all leave {least}" if least == most else f"leave between {least} and {most}")
                   + f", though they take from {exact.learn_samples.min():.0f} to {exact.learn_samples.max():.0f} samples to learn.")


def _names(part: pd.DataFrame) -> str:
    """The first few solvers, each with the settings or tiers of its learners."""
    by_solver = [f"{solver} with {', '.join(who.removeprefix(f'{solver}, ') for who in learners)}"
                 for solver, learners in part.groupby("solver", sort=False).who]
    return "; ".join(by_solver[:NAMED]) + (f" and {len(by_solver) - NAMED} more" if len(by_solver) > NAMED else "")


def by_window(rows: pd.DataFrame) -> pd.DataFrame:
    """RMS errors of both axes together, one row a stage, solver and settings, one column a window."""
    return rows[rows.window >= 0].groupby([*GROUP, "window"]).rms_percent.agg(root_mean_square).unstack()


def closed_loop(rows: pd.DataFrame) -> pd.DataFrame:
    """Tracking error against the cost gap of the weights in use, one row a stage and learner."""
    table = summary(rows[rows.window >= 0])
    table = table[table.cost_gap.notna()]
    return table.rename(columns={"who": "name"})[
        ["problem", "name", "solver", "lane", "settings", "cost_gap", "rms_percent", "straight_rms_percent", "learn_samples",
         "stale_samples"]].reset_index(drop=True)
