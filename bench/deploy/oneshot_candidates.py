"""The candidates of a one-shot race: scaled data from a cold start, as the compensator solves them; times of update and
solve.

Accuracy is judged by the rows of all hosts, times are those of one. Deadlines count hot and in turns with others;
percentiles are hot, since only one setting takes turns.
"""

from collections.abc import Iterator

import numpy as np

from bench.deploy.floor import Floor
from bench.deploy.rule import Candidate, Choice, Rule
from bench.derived.accuracy import CHEATS, distance, tainted
from bench.derived.answer_times import HOT, IN_TURNS, by_task, pooled
from bench.derived.measurements import FLOOR, Measurements
from bench.derived.tier_settings import PROBLEM, by_problem


def machine(found: Measurements) -> Floor:
    """What the solver that does nothing took, on all data."""
    calls, tasks = by_task(found.times, (HOT, IN_TURNS)), found.rows[found.rows.solver == FLOOR].task
    return Floor([one for task in dict.fromkeys(tasks) for one in calls.get(task, [])])


def candidates(found: Measurements, rule: Rule, floor: Floor) -> Iterator[Candidate]:
    """One a solver lane."""
    hot, raw = by_task(found.times), by_task(found.times, (HOT, IN_TURNS))
    cheats = (
        found.every[found.every.status.isin([str(status) for status in CHEATS])]
        .groupby(["solver", "lane"])
        .status.first()
    )
    cold = tainted(found.every)
    cold = cold[
        (cold.solver != FLOOR)
        & cold.lane.isin([str(lane) for lane in rule.lanes])
        & (cold.scaling == "scaled")
        & (cold.start == "cold")
        & (cold.rung >= 0)
    ]
    cold = cold.assign(number=cold.groupby(PROBLEM).ngroup(), error=distance(cold))
    for (solver, lane), part in cold.groupby(["solver", "lane"], sort=False):
        distances, rungs = by_problem(part)
        names = dict(zip(part.rung, part.setting, strict=True))
        chosen = Choice.of(distances, [names[rung] for rung in rungs], rule.accuracy)
        rows = found.rows[found.rows.task.isin(part.task[part.setting == chosen.setting])]
        calls = pooled(raw, rows.task)
        yield Candidate.of(
            (str(solver), str(lane)),
            chosen,
            str(cheats.get((solver, lane), "")),
            calls,
            floor.explained(calls, rule.deadline_us),
            rule.deadline_us,
            pooled(hot, rows.task),
            float(np.median(rows.update_us + rows.solve_us_p50)) if len(rows) else np.nan,
        )
