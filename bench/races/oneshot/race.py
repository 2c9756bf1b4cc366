"""The one-shot race: every problem, in each scaling, by every solver in every lane at every setting of its ladder.

For each problem and scaling the solvers are timed one after the other, each hot in its own process on the same core
at every setting; a second pass follows at one setting of each (`passes`). The null solver, which does nothing, is
the floor of all times.

In the first scaling every setting of every solver is measured on every problem, in the others only the defaults. A
wrapper shows the cost of another way to call a library, so it is measured at its defaults and at one more setting, the
one for a cost gap nearest to 1e-8.

Where solvers are added to a finished run, its fastest ones are timed again beside them, which tells how far the machine
is what it was.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import Any

from bench.derived.measurements import FLOOR, ONESHOT, Measurements
from bench.derived.ranking import PACE, ranking
from bench.messages import user_cache
from bench.messages.task import (
    NO_SETTING,
    PAPER,
    ChildSettings,
    Progress,
    RaceError,
    Setting,
    Task,
    Tier,
    default_setting,
    settings_ladder,
)
from bench.problems.protocol import RaceProblem
from bench.races import null_solver
from bench.races.driver import Part, Race
from bench.races.oneshot.passes import OneshotSettings, Pass, second_pass
from bench.races.run_problems import problems_of, save_certificates
from bench.report.words import joined, marked
from bench.store import Anchor, Run
from piezo_model.identification_problem import Scaling
from piezo_model.json_file import decoded
from solvers.protocol import setting_text
from solvers.registry import FAMILIES, Described, Entry, entries, find

EXPONENT = 8.0
"""Exponent of the cost gap at which wrappers are compared."""
ANCHORS = 2
"""Number of solver lanes that are timed again, the fastest of the run."""
FEWEST_JUDGED, JUDGED = 3, 24
"""Number of timed answers of a task that are judged at least, and of a setting over all problems."""


class OneshotRace(Race[OneshotSettings]):
    """Two passes, each divided by problem, scaling and repeat."""

    schema = ONESHOT
    preload = ("bench.races.oneshot.worker",)
    floor = spreads = True

    @classmethod
    def entries(cls, settings: OneshotSettings) -> Sequence[Entry]:
        """The selected solvers; RaceError if settings are given for one that does not race."""
        selected = super().entries(settings)
        for name in settings.given.keys() - {entry.name for entry in selected}:
            raise RaceError(f"settings are given for {name!r}, which does not race")
        return selected

    def __init__(self, run: Run, settings: OneshotSettings, progress: Progress) -> None:
        super().__init__(run, settings, progress)
        self.added, anchors = {*self.entrants}, run.sessions[-1]["anchors"] if run.session else []
        self.anchors = [(find(each["solver"], each["lane"]), Setting(each["setting"])) for each in anchors]
        self.entrants |= {(entry.name, entry.lane): entry for entry, _ in self.anchors}

    @property
    def child(self) -> ChildSettings:
        """Hide the certificates from the solvers."""
        return replace(super().child, hidden=(str(self.run.path.resolve()), str(user_cache.folder())))

    def prepare(self, resources: ExitStack) -> None:
        """Generate or load the problems."""
        self.problems = list(problems_of(self.run, self.settings, self.progress))

    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """The first pass and the second; each part begins with the null solver."""
        settings, session = self.settings, self.run.session
        added = [solver for solver in field if (solver.name, solver.lane) in self.added]

        def tasks(problem: RaceProblem, scaling: Scaling, repeat: int) -> Iterator[Task]:
            again = [(null_solver.ENTRY, NO_SETTING), *(self.anchors if scaling == settings.scalings[0] else ())]
            return tasks_of(settings, added, problem, scaling, repeat, session, again)

        first = [
            Pass(
                self.run.path.resolve(),
                f"{problem.set_name}--{problem.name}--{scaling}--{session}-{repeat}",
                tuple(tasks(problem, scaling, repeat)),
                repeat,
                settings,
                problem,
                scaling,
                max(FEWEST_JUDGED, math.ceil(JUDGED / len(self.problems))),
            )
            for repeat in range(settings.repeats)
            for problem in self.problems
            for scaling in settings.scalings
        ]
        yield first
        yield [*second_pass(self.run, settings, field, first)]

    def finish(self) -> None:
        """Save the certificates, which solvers must not see."""
        save_certificates(self.run, self.problems)


def tasks_of(
    settings: OneshotSettings,
    solvers: Sequence[Described],
    problem: RaceProblem,
    scaling: Scaling,
    repeat: int = 0,
    session: int = 0,
    again: Iterable[tuple[Entry, Setting]] = (),
) -> Iterator[Task]:
    """The tasks of a problem in one scaling: solver lanes that are timed ``again``, each at one setting, then all the
    others, those of a lane from loose to tight; the paper's method also begins at the straight
    line, as its compensator does."""
    first = scaling == settings.scalings[0]
    task = partial(Task, problem.set_name, problem.name, scaling, repeat=repeat, session=session, d=problem.d)
    yield from (task(entry.name, entry.lane, setting) for entry, setting in again)
    for solver in solvers:
        named = partial(task, solver.name, solver.lane)
        given = settings.given.get(solver.name, "")
        measured = first_pass_settings(solver, given) if first else [default_setting(solver)]
        yield from map(named, measured)
        if solver.name == PAPER and "line" in problem.forms[scaling].starts:
            yield from (named(setting, start="line") for setting in measured)


def first_pass_settings(solver: Described, given: str = "") -> Sequence[Setting]:
    """The settings of a solver that are measured in the first scaling: the default and ``given``, or the ladder."""
    if given:
        text = setting_text({**solver.defaults, **decoded(given, dict[str, Any])})
        return [default_setting(solver), Setting(text, 0, is_default=False, given=given)]
    every = settings_ladder(solver)
    if solver.lane not in FAMILIES or not solver.exponents:
        return every
    nearest = min(range(len(solver.exponents)), key=lambda rung: abs(solver.exponents[rung] - EXPONENT))
    return [setting for setting in every if setting.is_default or setting.rung == nearest]


def anchors(run: Run) -> list[Anchor]:
    """The fastest lanes of different solvers that reach 1e-9 on all problems and are installed."""
    found: dict[str, Anchor] = {}
    # not those from a file of the user's, whose code a run does not choose
    known = {(entry.name, str(entry.lane)) for entry in entries() if entry.lane not in FAMILIES}
    for line in ranking(Measurements.of(run)):
        high = line.results.get(Tier.HIGH)
        if high and high.reached and not line.partial and line.name != PACE and (line.solver, line.lane) in known:
            found.setdefault(line.solver, {"solver": line.solver, "lane": line.lane, "setting": high.setting})
    return [*found.values()][:ANCHORS]


def drift(run: Run, measurements: Measurements) -> Iterator[str]:
    """For each session a sentence on what the null solver and the anchors took in it, over what they took before."""
    every = run.rows(ONESHOT)
    before = measurements.rows.set_index("task").answer_us
    for number, session in enumerate(run.sessions, 1):
        rows = every[(every.session == number) & (every.timed == "hot")]
        times = []
        for solver, lane in [(FLOOR, ""), *((anchor["solver"], anchor["lane"]) for anchor in session["anchors"])]:
            again = rows[(rows.solver == solver) & (rows.lane.eq(lane) if lane else True)].set_index("task").answer_us
            ratio = (again / before.reindex(again.index)).median()
            times.append(f"{marked(solver)}{lane and f' ({lane})'} {ratio:.2f}")
        added = {*zip(rows.solver, rows.lane, strict=True)} - {(a["solver"], a["lane"]) for a in session["anchors"]}
        names = joined(sorted(f"{marked(solver)} ({lane})" for solver, lane in added if solver != FLOOR))
        yield (
            f"{names} joined later; beside them, what was timed again took this many times as long as before: "
            f"{joined(times)}."
        )
