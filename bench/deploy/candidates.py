"""The candidates of a one-shot race or a stream: solver lanes, each at its setting for the required accuracy."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from bench.deploy.floor import Floor
from bench.deploy.rule import Candidate, Choice, Rule
from bench.derived.accuracy import distance
from bench.derived.measurements import FLOOR, HOT, INTERLEAVED, Measurements
from bench.derived.tier_settings import PROBLEM, by_problem
from bench.races.stream.race import STREAM
from bench.races.stream.summary import raw
from bench.store import Run, RunError
from bench.timing.percentiles import rate_ratio
from bench.timing.schedule import runs


def of_oneshot(run: Run, rule: Rule) -> Iterator[Candidate]:
    """Candidates on scaled data from a cold start, as the compensator solves them; times include update and solve.

    Accuracy comes from the rows of all hosts, times from one of them. Deadlines count hot and interleaved calls;
    percentiles hot calls only, since only one setting is interleaved.
    """
    found = Measurements.of(run)
    null_tasks = found.rows[found.rows.solver == FLOOR].task
    floor = Floor([found.pooled([task], way) for task in null_tasks for way in (HOT, INTERLEAVED)])
    _require_useful_deadline(run, rule, int(np.count_nonzero(floor.calls > rule.deadline_us)), floor.calls.size)
    cold = found.every
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
        calls = found.pooled(rows.task, HOT, INTERLEAVED)
        yield Candidate.of(
            (str(solver), str(lane)),
            chosen,
            calls,
            floor.explained(calls, rule.deadline_us),
            rule.deadline_us,
            found.pooled(rows.task),
            float(rows.answer_us.median()),
        )


def of_stream(run: Run, rule: Rule) -> Iterator[Candidate]:
    """Candidates by the answer to each sample, and the time from its due time to its answer.

    Compiled loops are not on the schedule and are excluded. Of two settings of a lane, the less exact one is looser.
    """
    rows, times = run.rows(STREAM), run.times()

    def late(tasks: Iterable[str]) -> list[NDArray[np.bool_]]:
        return [raw(times, [task], "response") > rule.deadline_us for task in tasks]

    floor = late(rows.task[rows.solver == FLOOR])
    samples = sum(each.size for each in floor)
    _require_useful_deadline(run, rule, int(sum(each.sum() for each in floor)), samples)
    field = rows[(rows.solver != FLOOR) & rows.paced.astype(bool) & rows.lane.isin([str(lane) for lane in rule.lanes])]
    gaps = field.own_gap_max.astype(float).where(field.unanswered == 0).fillna(math.inf)
    for (solver, lane), part in field.assign(gap=gaps).groupby(["solver", "lane"], sort=False):
        worst = part.groupby("setting").gap.max().sort_values(ascending=False)
        chosen = Choice.of(
            worst.to_numpy(np.float64)[None, :], [str(setting) for setting in worst.index], rule.accuracy
        )
        tasks = part.task[part.setting == chosen.setting]
        calls, missed = raw(times, tasks, "response"), late(tasks)
        bouts = (sum(runs(each) for each in several) for several in (missed, floor))
        ratio = rate_ratio(next(bouts), max(calls.size, 1), next(bouts), samples)
        count = int(sum(each.sum() for each in missed))
        yield Candidate.of(
            (str(solver), str(lane)),
            chosen,
            calls,
            (math.floor(count / max(1.0, ratio[1])), math.ceil(count / max(1.0, ratio[0]))),
            rule.deadline_us,
            calls,
            float(np.median(calls)) if calls.size else math.nan,
        )


def _require_useful_deadline(run: Run, rule: Rule, missed: int, samples: int) -> None:
    """RunError if the machine itself misses most deadlines."""
    if missed > samples / 2:
        raise RunError(
            f"{run.path}: a solver that does nothing misses {missed} of {samples} deadlines of "
            f"{rule.deadline_us:g} µs, so this run says nothing about them"
        )
