"""From a run to a decision: which solver a controller gets, with what model, and why.

The rule, in this order:

1. The answer to every problem is within the accuracy asked for, cost gap and violation alike, and a solver that missed every tier
   that it was raced at is out.
2. No deadline is missed that the machine's floor does not explain: with m of M missed by a solver that does nothing
   and r the upper 95 % bound of that rate, at most ⌈r N⌉ of N.
3. Of those that are left, the one with the lowest p99.9 of the time of an answer (in a stream: of the response). Whoever has too
   few samples for it is out; where all have, p99 decides, or the median.

A deadline that the machine itself misses more often than not is refused, since nothing could be told by it.

The model comes from a file, or from a problem of the run that is a recording of one's own; others have to be asked for by name, and
simulated ones twice.

"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from bench import problems
from bench.races import null_solver
from bench.races.metrics import relative_gap
from bench.races.oneshot import answer_times
from bench.races.oneshot.answer_times import HOT, IN_TURNS, Microseconds
from bench.races.oneshot.rows import ONESHOT
from bench.races.stream import figures as stream_figures
from bench.races.stream.race import KIND as STREAM_KIND
from bench.races.stream.race import STREAM
from bench.report.words import gap, marked, number
from bench.store import Run, RunError
from bench.timing.percentiles import Percentile, percentile, rate_bound
from bench.timing.schedule import PERIOD_US
from piezo_model import HysteresisCreepModel
from piezo_model.deployment import Deployment
from piezo_model.json_file import decoded
from solvers import Lane, Status, Tier, find

WHO = ["solver", "lane", "rung", "settings"]
QUANTILES = (0.999, 0.99, 0.5)
RANK = [str(tier) for tier in (Tier.DEFAULT, Tier.LOW, Tier.STAGE, Tier.MID, Tier.HIGH, Tier.EXACT)]
"""Tiers from loose to exact."""
CONTINUOUS = "recursive_active_set"
"""The solver that follows every sample."""


@dataclass(frozen=True)
class Rule:
    """What is asked for."""

    accuracy: float = 1e-9
    """Largest relative cost gap and violation."""
    deadline_us: float = PERIOD_US
    lanes: tuple[Lane, ...] = (Lane.KERNEL, Lane.DIRECT)
    """Lanes that a controller can have."""
    misses: int = 0
    """Deadlines that may be missed beyond the floor."""

    @property
    def sentence(self) -> str:
        """The rule in words."""
        return (f"cost gap and violation of at most {self.accuracy:g} on every problem, at most {self.misses} deadlines of "
                f"{self.deadline_us:g} µs missed beyond those that the machine itself misses, then the lowest p99.9; lanes {', '.join(self.lanes)}.")


@dataclass(frozen=True)
class Candidate:
    """One solver lane with its settings, and how it stands to the rule."""

    solver: str
    lane: str
    tier: str
    """The most exact that it reaches on every problem, "" if it misses all."""
    settings: dict[str, Any]
    """Its rung, or its own."""
    gap: float
    violation: float
    """The worst over the problems; infinite where one has no answer."""
    problems: int
    right: int
    samples: int
    missed: int
    beyond_floor: int
    """Deadlines missed beyond those that the floor explains."""
    time_us: float
    """Median as the report of the race has it."""
    tail: tuple[Percentile, ...]
    """For QUANTILES, each with value or reason."""

    @property
    def name(self) -> str:
        """For people."""
        more = "".join(f", {name} {value}" for name, value in self.settings.items())
        return f"{marked(self.solver)} ({self.lane}, {self.tier or Status.MISSED}{more})"

    def failing(self, rule: Rule) -> str:
        """Why it does not qualify; "" if it does."""
        if self.right < self.problems:
            return f"has a cost gap or violation above {rule.accuracy:g} on {self.problems - self.right} of {self.problems} problems"
        if not self.tier:
            return "missed every tier that it was raced at"
        if not self.samples:
            return "has no times"
        if self.beyond_floor > rule.misses:
            return f"misses {self.missed} of {self.samples} deadlines, {self.beyond_floor} more than the machine itself explains"
        try:
            find(self.solver, self.lane)
        except KeyError:
            return "is of a file of your own, from which a compensator cannot take its solver"
        return ""

    def figures(self) -> dict[str, Any]:
        """Figures as JSON can hold them, in the units of the report."""
        return {"solver": self.solver, "lane": self.lane, "tier": self.tier, "settings": self.settings, "samples": self.samples,
                "worst_cost_gap": self.gap if math.isfinite(self.gap) else None,
                "worst_violation": self.violation if math.isfinite(self.violation) else None, "problems": self.problems, "right": self.right,
                "missed": self.missed, "missed_beyond_floor": self.beyond_floor,
                "median_us": self.time_us, "median_periods": self.time_us / PERIOD_US,
                **{f"{each.name}_us": each.value for each in self.tail[:-1]}}

    def time(self, by: int) -> float:
        """What decides, µs: the percentile of that index, or the median."""
        return self.time_us if by == len(QUANTILES) - 1 else self.tail[by].value or math.nan


@dataclass(frozen=True)
class Decision:
    """The choice and those that it was made among."""

    run: Run
    rule: Rule
    chosen: Candidate
    runners_up: tuple[Candidate, ...]
    """Those that qualify, too, in order."""
    refused: tuple[tuple[Candidate, str], ...]
    """The others, with why, the nearest first."""
    by: int
    """Index in QUANTILES of the percentile that decided."""

    def sentences(self) -> list[str]:
        """Why, and what else there was."""
        it, name = self.chosen, "median" if self.by == len(QUANTILES) - 1 else Percentile(QUANTILES[self.by]).name
        found = [f"Rule: {self.rule.sentence}",
                 f"Chosen: {it.name}: worst cost gap {gap(it.gap)} over {it.problems} problems; {it.missed} of {it.samples} deadlines missed, "
                 f"{it.beyond_floor} of them its own; {name} of an answer {number(it.time(self.by))} µs."]
        if self.by:
            found.append(f"Decided by the {name}, since p99.9 {it.tail[0].reason}, and none of those that qualify has as many.")
        found += [f"Runner-up: {each.name}, {name} {number(each.time(self.by))} µs." for each in self.others[:3]]
        count = len(self.refused)
        return [*found, f"{count} other setting{'s do' if count != 1 else ' does'} not qualify."] if count else found

    @property
    def others(self) -> list[Candidate]:
        """The best of each solver lane that qualifies, too, but the chosen one's."""
        best = {(each.solver, each.lane): each for each in reversed(self.runners_up)}
        best.pop((self.chosen.solver, self.chosen.lane), None)
        return [each for each in self.runners_up if each in best.values()]

    def evidence(self) -> dict[str, Any]:
        """What the file says about where it comes from."""
        settings = self.run.settings
        return {"run": self.run.path.name, "race": settings.get("race", "oneshot"), "machine": settings["machine"],
                "solver_version": settings.get("field", {}).get(f"{self.chosen.solver} ({self.chosen.lane})", ""),
                "rule": self.rule.sentence, "why": self.sentences(), "figures": self.chosen.figures(),
                "runners_up": [each.figures() for each in self.others[:3]]}


def decide(run: Run, rule: Rule) -> Decision:
    """Apply the rule.

    RunError where no solver qualifies, or the run is of a kind without deadlines.
    """
    race = run.settings.get("race", "oneshot")
    if race not in ("oneshot", STREAM_KIND):
        raise RunError(f"{run.path} is a {race} race; a decision needs a one-shot race or a stream")
    candidates = list(_of_stream(run, rule) if race == STREAM_KIND else _of_oneshot(run, rule))
    verdicts = [(each, each.failing(rule)) for each in candidates]
    qualified, refused = [each for each, why in verdicts if not why], [(each, why) for each, why in verdicts if why]
    refused.sort(key=lambda pair: (pair[0].right < pair[0].problems, pair[0].beyond_floor, pair[0].gap))
    if not qualified:
        raise RunError(f"{run.path}: no solver qualifies" + (f"; the nearest, {refused[0][0].name}, {refused[0][1]}" if refused else
                                                              f", none of its solvers is in the lanes {', '.join(rule.lanes)}"))
    by = next((i for i in range(len(QUANTILES)) if any(each.tail[i].value is not None for each in qualified)), None)
    if by is None:
        raise RunError(f"{run.path}: too few times to tell the solvers from each other; a median {qualified[0].tail[-1].reason}")
    unknown = [(each, f"has {each.samples} samples, and its {each.tail[by].name} {each.tail[by].reason}")
               for each in qualified if each.tail[by].value is None]
    ranked = sorted((each for each in qualified if each.tail[by].value is not None), key=lambda each: (each.time(by), each.name))
    return Decision(run, rule, ranked[0], tuple(ranked[1:]), (*unknown, *refused), by)


def _judged(run: Run, rule: Rule, missed: int, samples: int) -> None:
    """RunError where the machine itself misses most deadlines."""
    if missed > samples / 2:
        raise RunError(f"{run.path}: a solver that does nothing misses {missed} of {samples} deadlines of {rule.deadline_us:g} µs, so "
                       "this run says nothing about them")


def _of_oneshot(run: Run, rule: Rule) -> Iterable[Candidate]:
    """Scaled data from a cold start, as the compensator solves it; times of update and solve.

    Deadlines count hot and in turns with others; percentiles are hot, since only one tier takes turns. Rungs for the picture are left
    out: to take one for what it reached here would be to tune on the problems that are raced.
    """
    rows, times = run.rows(ONESHOT), run.times()
    rows = rows[(rows.scaling == "scaled") & (rows.start == "cold") & (rows.tier != Tier.RUNG)]
    hot, raw = answer_times.by_task(times), answer_times.by_task(times, (HOT, IN_TURNS))
    floor = answer_times.pooled(raw, rows[rows.solver == null_solver.ENTRY.name].task)
    missed = int(np.count_nonzero(floor > rule.deadline_us))
    _judged(run, rule, missed, floor.size)
    bound = rate_bound(missed, floor.size) if floor.size else 0.0  # nothing is forgiven where it was not measured
    field = rows[(rows.solver != null_solver.ENTRY.name) & rows.lane.isin([str(lane) for lane in rule.lanes])]
    for names, whole in field.groupby(WHO[:3], sort=False):
        part, met = whole.drop_duplicates("task"), (whole.status == Status.OK).groupby(whole.tier).all()
        tier = max(met.index[met], key=RANK.index, default="")
        worst = part[["cost_gap", "violation"]].fillna(math.inf)
        yield _candidate((*names[:2], tier, {"rung": int(whole.rung.iloc[0])}), worst, answer_times.pooled(raw, part.task), bound, rule,
                         answer_times.pooled(hot, part.task), float((part.update_us + part.solve_us_p50).median()))


def _of_stream(run: Run, rule: Rule) -> Iterable[Candidate]:
    """Each sample's own answer; times from its due time to its answer. Compiled loops have none and are left out."""
    rows, times = run.rows(STREAM), run.times()
    floor = rows[rows.solver == stream_figures.FLOOR]
    _judged(run, rule, int(floor.missed.sum()), int(floor.samples.sum()))
    bound = stream_figures.floor_bound(floor)
    paced = (rows.solver != stream_figures.FLOOR) & rows.paced.astype(bool)
    field = rows[paced & rows.lane.isin([str(lane) for lane in rule.lanes])]
    for (solver, lane, _, text), part in field.groupby(WHO, sort=False):
        gaps = part.own_gap_max.astype(float).where(part.unanswered == 0).fillna(math.inf)
        tier = "" if (part.status == Status.MISSED).any() else part.tier.iloc[0]
        steps = decoded(str(text), dict[str, Any]).get("steps")
        settings = {"steps": steps} if steps else {"rung": int(part.rung.iloc[0])}
        us = stream_figures.raw(times, part.task, "response")
        yield _candidate((solver, lane, tier, settings), pd.DataFrame({"cost_gap": gaps, "violation": 0.0}), us, bound, rule, us,
                         float(np.median(us)) if us.size else math.nan)


def _candidate(who: Any, worst: pd.DataFrame, us: Microseconds, bound: float, rule: Rule, tail: Microseconds,
               time_us: float) -> Candidate:
    """Deadlines from the times ``us``, percentiles from ``tail``."""
    solver, lane, tier, settings = who
    missed = int(np.count_nonzero(us > rule.deadline_us))
    return Candidate(str(solver), str(lane), str(tier), settings, float(worst.cost_gap.max()), float(worst.violation.max()), len(worst),
                     int((worst <= rule.accuracy).all(axis=1).sum()), us.size, missed, max(0, missed - math.ceil(bound * us.size)), time_us,
                     tuple(percentile(tail, q) for q in QUANTILES))


def deployment(decision: Decision, model: HysteresisCreepModel | None = None, problem: str | None = None, simulated: bool = False) -> Deployment:
    """The file's content: a model of one's own, or the proven optimum of a problem of the run.

    The problem is "set/name", by default the first that is a recording of one's own; ``simulated`` says whether a simulated actuator will
    do. RunError where there is no such problem.
    """
    evidence = decision.evidence()
    if model is None:
        model, evidence["model_from"], evidence["certificate"] = _proven(decision.run, problem, simulated)
    else:
        evidence |= {"model_from": "the model file that was given", "certificate": dict(model.report.get("certificate", {}))}
    s, chosen = model.structure, decision.chosen
    continuous = chosen.solver == CONTINUOUS and evidence["race"] == STREAM_KIND
    return Deployment(model=model, solver=chosen.solver, lane=Lane(chosen.lane), tier=Tier(chosen.tier), settings=chosen.settings,
                      mode="continuous" if continuous else "cyclic", x_limits=(s.x_centre - s.x_scale, s.x_centre + s.x_scale), evidence=evidence)


def _proven(run: Run, asked: str | None, simulated: bool) -> tuple[HysteresisCreepModel, str, dict[str, Any]]:
    """The model of a problem's optimum, where that comes from, and its certificate."""
    if run.settings.get("race", "oneshot") == STREAM_KIND:
        raise RunError(f"{run.path}: a stream holds no model; give one with --model, as identify writes it")
    rows = run.rows(ONESHOT).drop_duplicates(["problem_set", "problem"])
    names = {f"{one}/{two}": (str(one), str(two)) for one, two in zip(rows.problem_set, rows.problem, strict=True)}
    if asked is not None and asked not in names:
        raise RunError(f"{run.path} has no problem {asked!r}; there are {', '.join(names)}")
    wanted = "simulated" if simulated else "a recording of yours"
    for name, who in names.items():
        origin = problems.find(who[0]).origin
        if name != asked if asked else origin != wanted:
            continue
        if origin == "simulated" and not simulated:
            raise RunError(f"{run.path}: {name} is a simulated actuator; give a model with --model, or --simulated to take it all the same")
        problem = run.problem(*who)
        if problem.validation is not None:
            form = problem.forms["scaled"]
            cost_gap, violation = relative_gap(form, np.array(form.certificate.x))
            return (HysteresisCreepModel.from_weights(problem.validation.structure, problem.optimal_weights), f"the problem {name}, {origin}",
                    {"problem_of_run": name, "cost_gap": cost_gap, "violation": violation, **asdict(form.certificate)})
    raise RunError(f"{run.path} holds no model of {'a simulated actuator' if simulated else 'your actuator'}; give one with --model, as identify "
                   "writes it, name a problem with --problem, or take a simulated actuator with --simulated")
