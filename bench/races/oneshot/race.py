"""The one-shot race: every problem, in each scaling, by every solver in every lane at every setting of its ladder.

For each problem and scaling the solvers are timed one after the other, each hot in its own process on the same core
(`first_pass`); a second pass follows at one setting of each (`second_pass`). The null solver, which does nothing, is
the floor of all times.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace

from bench.derived.measurements import ONESHOT
from bench.messages import user_cache
from bench.messages.progress import Progress
from bench.messages.race_error import RaceError
from bench.messages.task import NO_SETTING, Setting, Task
from bench.problems.protocol import RaceProblem
from bench.processes.worker import ChildSettings
from bench.races import null_solver
from bench.races.driver import Part, Race
from bench.races.oneshot.first_pass import FirstPass
from bench.races.oneshot.second_pass import second_pass
from bench.races.oneshot.settings import OneshotSettings, tasks_of
from bench.races.run_problems import problems_of, save_certificates
from bench.store import Run
from piezo_model.identification_problem import Scaling
from solvers import Lane, find
from solvers.registry import Described, Entry

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
        self.anchors = run.sessions[-1]["anchors"] if run.session else []
        self.added = {*self.entrants}
        for anchor in self.anchors:
            entry = find(anchor["solver"], anchor["lane"])
            self.entrants[entry.name, entry.lane] = entry

    @property
    def child(self) -> ChildSettings:
        """Hide the certificates from the solvers."""
        return replace(super().child, hidden=(str(self.run.path.resolve()), str(user_cache.folder())))

    def prepare(self, resources: ExitStack) -> None:
        """Generate or load the problems."""
        self.problems = list(problems_of(self.run, self.settings, self.progress))

    def phases(self, field: Sequence[Described]) -> Iterator[Sequence[Part]]:
        """The first pass and the second; each part begins with the null solver."""
        settings, floor, session = self.settings, null_solver.ENTRY, self.run.session
        added = [solver for solver in field if (solver.name, solver.lane) in self.added]
        first = [
            FirstPass(
                self.run.path.resolve(),
                f"{problem.set_name}--{problem.name}--{scaling}--{session}-{repeat}",
                (
                    Task(
                        problem.set_name,
                        problem.name,
                        scaling,
                        floor.name,
                        floor.lane,
                        NO_SETTING,
                        repeat=repeat,
                        session=session,
                        d=problem.d,
                    ),
                    *self.anchor_tasks(problem, scaling, repeat),
                    *tasks_of(settings, added, problem, scaling, repeat, session),
                ),
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

    def anchor_tasks(self, problem: RaceProblem, scaling: Scaling, repeat: int) -> Iterator[Task]:
        """The anchors again, in the first scaling."""
        for anchor in self.anchors if scaling == self.settings.scalings[0] else ():
            yield Task(
                problem.set_name,
                problem.name,
                scaling,
                anchor["solver"],
                Lane(anchor["lane"]),
                Setting(anchor["setting"]),
                repeat=repeat,
                session=self.run.session,
                d=problem.d,
            )

    def finish(self) -> None:
        """Save the certificates, which solvers must not see."""
        save_certificates(self.run, self.problems)
