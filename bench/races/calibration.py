"""Which rung of its ladder a solver needs to reach an accuracy, found out on problems that are not raced.

    Per solver, lane, scaling, set and target, the setting is the loosest of at most eight fixed rungs whose judged gap and
    violation are at most a tenth of the target on all calibration problems: the same set, each problem under one of three
    other seeds.

This margin is for the data of the race, which are others; where no rung has it, the loosest with the next of MARGINS is raced,
and where none meets the target itself, the one that got furthest, the tightest of several, which misses. A setting is chosen by
accuracy, never by the clock, and frozen for the race. Rungs are tried from the loosest on, and one ends at its first miss: those that are
too loose cost a solve or two, and only those that are found a pass over all problems. What takes more than WORK_S of processor
time in a scaling of a set is not raced at the targets that are open by then.

Only the lanes direct and kernel are searched. What calls a library in another way takes the rung of its direct lane. Sets that
are made from files have no other seeds; they take the tightest of what other sets need.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bench.passed.progress import Progress
from bench.passed.task import UNASKED
from bench.problems import find
from bench.problems.protocol import RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races import calibration_store
from bench.races.calibration_worker import Answer, Calibrate, Calibrated
from bench.races.metrics import model_error, reaches, relative_gap, stage_excess
from bench.races.settings import RaceSettings
from bench.store import Run
from piezo_model.identification_problem import Scaling
from solvers import Lane, Tier
from solvers.arrays import Vector
from solvers.registry import Described

TARGETS = (Tier.LOW, Tier.MID, Tier.HIGH, Tier.EXACT, Tier.STAGE)
SEARCHED = (Lane.KERNEL, Lane.DIRECT, Lane.CODEGEN)
IN_DEPTH = (Lane.KERNEL, Lane.DIRECT)
WORK_S = 2.0
MARGINS = (10.0, 3.0, 1.0)
CHUNKS = (1, 4, 16)
"""Problems of the first requests for a rung; the next one is for all that are left."""
IN_LANE_DIRECT = {"highs": "highspy", "proxqp": "proxsuite"}
"""Solvers that qpsolvers and cvxpy call otherwise than the lane direct does."""

Who = tuple[str, Lane]
Measurement = tuple[int, tuple[Tier, ...]]
"""A rung and the tiers that it serves."""


@dataclass(frozen=True)
class Found:
    """The rung for a target, and whether it met it on all calibration problems; no rung where work ended first."""

    rung: int | None
    met: bool


class Judged:
    """An answer, of which no more is measured than is asked for."""

    def __init__(self, problem: RaceProblem, scaling: Scaling, answer: Answer) -> None:
        self._problem, self._form, x = problem, problem.forms[scaling], answer.x
        self.is_one = answer.found and x is not None and x.shape == self._form.qp.q.shape and bool(np.isfinite(x).all())
        self._x: Vector = x if self.is_one and x is not None else np.zeros(0)

    def reaches(self, target: Tier, margin: float = 1.0) -> bool:
        """Whether the answer is so many times as exact as the target asks."""
        return self.is_one and reaches(target, margin * self._gap[0], margin * self._gap[1], lambda: self._excess)

    @cached_property
    def _gap(self) -> tuple[float, float]:
        return relative_gap(self._form, self._x)

    @cached_property
    def _excess(self) -> float:
        return stage_excess(self._problem, model_error(self._problem, self._form, self._x))


class Search:
    """The rungs of one solver lane on some problems in one scaling.

    Parameters
    ----------
    problems : sequence of RaceProblem
    scaling : str
    rungs : int
        Length of the ladder.
    child : SolverChild
    """

    def __init__(self, problems: Sequence[RaceProblem], scaling: Scaling, rungs: int, child: SolverChild) -> None:
        self._problems, self._scaling, self._rungs, self._child = problems, scaling, rungs, child
        self._answers: dict[tuple[int, int], Judged] = {}
        self._order = list(range(len(problems)))
        self._spent_s = 0.0

    def find(self, target: Tier) -> Found:
        """The loosest rung that meets the target everywhere, with a margin if one does, else the one that got furthest."""
        if target is Tier.STAGE and not all(problem.has_noise for problem in self._problems):
            return Found(None, False)
        for margin in MARGINS:
            for rung in range(self._rungs):
                if self._meets(rung, target, margin):
                    return Found(rung, True)
        if self._spent_s > WORK_S:
            return Found(None, False)
        return Found(max(range(self._rungs), key=lambda rung: (*self._count(rung, target), rung)), False)

    def _meets(self, rung: int, target: Tier, margin: float) -> bool:
        left, chunks = list(self._order), iter(CHUNKS)
        while left:
            size = next(chunks, len(left))
            now, left = left[:size], left[size:]
            unanswered = [i for i in now if (rung, i) not in self._answers]
            if unanswered and self._spent_s > WORK_S:
                return False
            self._answer(rung, unanswered)
            for i in now:
                if not self._answers[rung, i].reaches(target, margin):
                    self._order.remove(i)
                    self._order.insert(0, i)  # what one rung misses, the next may miss, too
                    return False
        return True

    def _answer(self, rung: int, indices: Sequence[int]) -> None:
        """Have problems answered and judged."""
        if indices:
            forms = [self._problems[i].forms[self._scaling] for i in indices]
            found = Calibrated.of(self._child.ask(Calibrate.of(forms, rung)))
            self._spent_s += found.spent_s
            answers: Iterable[Answer] = found.answers or [Answer(found.failure or "crashed", found.message) for _ in indices]
            for i, answer in zip(indices, answers, strict=True):
                self._answers[rung, i] = Judged(self._problems[i], self._scaling, answer)

    def _count(self, rung: int, target: Tier) -> tuple[int, int]:
        """On how many problems a rung is known to meet the target, and to answer at all."""
        judged = [judged for (at, _), judged in self._answers.items() if at == rung]
        return sum(one.reaches(target) for one in judged), sum(one.is_one for one in judged)


def rungs_of(run: Run, settings: RaceSettings, field: Sequence[Described], children: Mapping[Who, SolverChild],
             set_name: str, scaling: Scaling, progress: Progress) -> dict[Who, dict[Tier, Found]]:
    """The rung of each solver lane for each target that is asked for, as the run noted them or found out now and noted."""
    name = f"{set_name}, {scaling}"
    noted = run.settings.get("calibration", {})
    if name not in noted:
        found = _calibrated(settings, field, children, set_name, scaling, progress)
        noted = {**noted, name: {f"{solver} ({lane})": {tier: (one.rung, one.met) for tier, one in tiers.items()}
                                 for (solver, lane), tiers in found.items()}}
        run.note(calibration=noted)
    return {(solver.name, solver.lane): {tier: Found(*one) for tier, one in noted[name].get(
        f"{solver.name} ({solver.lane})", {}).items()} for solver in field}


def _calibrated(settings: RaceSettings, field: Sequence[Described], children: Mapping[Who, SolverChild], set_name: str,
                scaling: Scaling, progress: Progress) -> dict[Who, dict[Tier, Found]]:
    found: dict[Who, dict[Tier, Found]] = {}
    sets = find(set_name).calibrated_on or (set_name,)
    problems: dict[str, list[RaceProblem]] = {}
    known = {(solver.name, solver.lane) for solver in field}
    for done, solver in enumerate(field):
        who = solver.name, solver.lane
        twin = IN_LANE_DIRECT.get(solver.name, solver.name), Lane.DIRECT
        targets = [tier for tier in tiers_of(settings, solver.lane, scaling) if tier in TARGETS]
        if solver.lane not in SEARCHED and twin in known:
            targets = []  # it takes what the direct lane finds, below
        if not targets or len(solver.ladder) == 1:
            found[who] = {tier: Found(0, True) for tier in targets}
            continue
        by_set: list[dict[Tier, Found]] = []
        for of_set in sets:
            key = calibration_store.key(settings, of_set, scaling, solver)
            ours = {tier: Found(*one) for tier, one in calibration_store.load(key).items()}
            if missing := [tier for tier in targets if tier not in ours]:
                progress(f"settings of {solver.name} ({solver.lane}), {scaling}", done, len(field))
                if of_set not in problems:
                    problems[of_set] = calibration_store.problems(of_set, settings, progress)
                search = Search(problems[of_set], scaling, len(solver.ladder), children[who])
                ours |= {tier: search.find(tier) for tier in missing}
                calibration_store.save(key, {tier: (one.rung, one.met) for tier, one in ours.items()})
            by_set.append(ours)
        found[who] = {tier: tightest([ours[tier] for ours in by_set]) for tier in targets}
    for solver in field:
        twin = IN_LANE_DIRECT.get(solver.name, solver.name), Lane.DIRECT
        if solver.lane not in SEARCHED and twin in known:
            last = len(solver.ladder) - 1
            found[solver.name, solver.lane] = {tier: Found(None if one.rung is None else min(one.rung, last), one.met)
                                               for tier, one in found[twin].items() if tier in tiers_of(settings, solver.lane, scaling)}
    return found


def tightest(several: Sequence[Found]) -> Found:
    """The rung that serves as the tightest of several does; none where one search ended before it found any."""
    rungs = [one.rung for one in several if one.rung is not None]
    return Found(max(rungs) if len(rungs) == len(several) else None, all(one.met for one in several))


def tiers_of(settings: RaceSettings, lane: Lane, scaling: Scaling) -> Sequence[Tier]:
    """The tiers that are raced: in the lanes kernel and direct those that are asked for.

    Else what is done unasked and `mid`, which shows what a wrapper costs. Where all are asked for, data of other scalings are raced so,
    too, and in those two lanes alone.
    """
    some = [tier for tier in settings.tiers if tier in (Tier.DEFAULT, Tier.MID)] or settings.tiers
    if scaling == settings.scalings[0] or set(settings.tiers) != set(Tier):
        return settings.tiers if lane in IN_DEPTH else some
    return some if lane in IN_DEPTH else ()


def measurements(settings: RaceSettings, solver: Described, found: Mapping[Tier, Found], scaling: Scaling) -> list[Measurement]:
    """What is measured of a solver lane: each rung once, with the tiers that it serves; what is done unasked may be a rung, too.

    The picture has all rungs, or where work ended a search those that it came to.
    """
    asked = tiers_of(settings, solver.lane, scaling)
    same = [i for i, rung in enumerate(solver.ladder) if dict(rung) == dict(solver.unasked)]
    by_rung: dict[int, list[Tier]] = {}
    for tier in asked:
        if tier is Tier.DEFAULT:
            by_rung.setdefault(same[0] if same else UNASKED, []).append(tier)
        elif tier in found and (rung := found[tier].rung) is not None:
            by_rung.setdefault(rung, []).append(tier)
    if Tier.RUNG in asked:
        ended = any(one.rung is None for tier, one in found.items() if tier is not Tier.STAGE)
        for rung in range(1 + max((one.rung or 0 for one in found.values()), default=0) if ended else len(solver.ladder)):
            by_rung.setdefault(rung, [Tier.RUNG])
    return [(rung, tuple(tiers)) for rung, tiers in sorted(by_rung.items())]


