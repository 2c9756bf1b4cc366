"""What the interactive plot of an anytime race shows, as a table."""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.races.anytime import figures
from bench.races.anytime.race import BUDGETS
from bench.report.charts import NAMED
from bench.report.words import marked


def anytime(rows: pd.DataFrame) -> pd.DataFrame:
    """Median and worst gap within each budget, one row a curve and budget."""
    table = figures.summary(rows)
    table = table[np.isfinite(table.median_gap)]
    pace = np.where(table.pace == figures.PAPER, ", " + table.pace, "")
    view = table.problem_set + ", d = " + table.d.astype(str) + ", " + table.scaling + " data"
    table = table.assign(view=view, name=table.solver.map(marked) + " (" + table.lane + pace + ")", front=False)
    for _, part in table.groupby("view"):
        early = part[part.budget == BUDGETS[0]].nsmallest(NAMED - 1, "median_gap").name
        stepwise = part[part.pace == figures.PAPER].name
        table.loc[part.index, "front"] = part.name.isin([*early, *stepwise])
    return table[["view", "name", "solver", "lane", "pace", "budget", "problems", "median_gap", "worst_gap", "front"]].reset_index(drop=True)
