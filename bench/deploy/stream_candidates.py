"""The candidates of a stream: each sample's own answer, and the times from its due time to its answer.

Compiled loops are not on the schedule and are left out. Of several settings of a solver lane, the less exact one is the
looser.
"""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from bench.deploy.rule import Candidate, Choice, Rule
from bench.races.stream.figures import FLOOR, floor_bound, raw


def candidates(rows: pd.DataFrame, times: pd.DataFrame, rule: Rule) -> Iterator[Candidate]:
    """One a solver lane."""
    bound = floor_bound(rows[rows.solver == FLOOR])
    field = rows[(rows.solver != FLOOR) & rows.paced.astype(bool) & rows.lane.isin([str(lane) for lane in rule.lanes])]
    gaps = field.own_gap_max.astype(float).where(field.unanswered == 0).fillna(math.inf)
    for (solver, lane), part in field.assign(gap=gaps).groupby(["solver", "lane"], sort=False):
        worst = part.groupby("setting").gap.max().sort_values(ascending=False)
        chosen = Choice.of(
            worst.to_numpy(np.float64)[None, :], [str(setting) for setting in worst.index], rule.accuracy
        )
        calls = raw(times, part.task[part.setting == chosen.setting], "response")
        yield Candidate.of(
            (str(solver), str(lane)),
            chosen,
            "",
            calls,
            math.ceil(bound * calls.size),
            rule.deadline_us,
            calls,
            float(np.median(calls)) if calls.size else math.nan,
        )
