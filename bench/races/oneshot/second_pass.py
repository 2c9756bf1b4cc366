"""The second pass, after all settings were measured on all problems: turns, starts from the optimum before, and more calls of the fastest.

Each solver lane has one setting here: that which stands for 1e-9, else for 1e-6, else what it does unasked, by first answers alone. Timed
answers are to data that each race draws anew, and with them two races of the same problems would take turns at different settings, which
cannot be compared. The run notes the settings when the pass begins, since it measures some of the rows again from which they follow, and a
resumed race has to go on as it began. Solvers that take turns must sit in one place, so a problem is never divided between workers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from bench.derived.measurements import at_tiers
from bench.derived.tier_settings import tier_settings
from bench.passed.row import Row
from bench.passed.task import Task
from bench.problems.fresh import FreshData
from bench.processes.line_up import LineUp
from bench.races import null_solver
from bench.races.oneshot.rows import with_turns
from bench.races.oneshot.settings import OneshotSettings
from bench.races.oneshot.turns import take_turns
from bench.races.oneshot.unit import Pass, Tell, Unit, measure
from bench.races.oneshot.worker import Forget
from bench.store import Planned, Run
from bench.timing.clock import Effort
from solvers import Status, Tier
from solvers.registry import FAMILIES, Described

LONGEST_US = 1000.0
"""Whatever takes longer hot has no turn: caches do not matter there, and time does."""
PREFERRED = (Tier.HIGH, Tier.MID)
NEAR = 2.0
"""How many times as long as the fastest of its lane a solver may take to be among the candidates for a decision."""
ENOUGH = 3_000
"""Calls of a candidate over all problems, enough for p99.9."""

Who = tuple[str, str, str]
"""Scaling, solver and lane."""


@dataclass(frozen=True)
class SecondPass(Pass):
    """The second pass; its tasks are measured already, one a solver lane."""

    warm: tuple[Task, ...]
    longer: tuple[Task, ...]
    """Those to be measured again with ``calls``."""
    calls: int

    @property
    def name(self) -> str:
        """A file name."""
        return f"{super().name}--turns"

    def timed(self, run: Run, line_up: LineUp, tell: Tell) -> list[Row]:
        """More calls of some, warm starts, and turns."""
        effort = self.settings.effort
        for task in self.longer:
            tell(task)
            if run.task(task)[0][0]["samples"] < self.calls:
                measure(run, self.problem, task, FreshData(self.form, self.calls), line_up, Effort(1.0, 1, self.calls), look_closer=False)
        for task in self.warm:
            tell(task)
            if not run.is_done(task):
                measure(run, self.problem, task, FreshData(self.form, effort.most), line_up, effort, look_closer=True)
        rows = [(task, run.task(task)[0][0]) for task in (*self.tasks, *self.warm)]
        if self.settings.rounds:
            self._take_turns(run, line_up, [task for task, row in rows if row["update_us"] + row["solve_us_p50"] <= LONGEST_US])
        return [row for task, row in rows if task in (*self.longer, *self.warm)]

    def _take_turns(self, run: Run, line_up: LineUp, tasks: Sequence[Task]) -> None:
        """Rounds, whose figures are added to the tasks on disk."""
        for task, tally in take_turns(tasks, line_up.children, self.form, FreshData(self.form, self.settings.effort.most), self.settings.rounds,
                                      f"{self.settings.seed} {self.name}"):
            (row,), times = run.task(task)
            turns = {"interleaved_update": np.concatenate(tally.updates), "interleaved_solve": np.concatenate(tally.solves)}
            run.save(task, with_turns(row, turns["interleaved_solve"]), {**times, **turns})
        for child in line_up.children.values():
            if child.is_running:
                child.ask(Forget())


def second_pass(run: Run, settings: OneshotSettings, field: Sequence[Described], units: Sequence[Unit]) -> list[SecondPass]:
    """The second pass over every problem, by what the first has found."""
    if "second_pass" not in run.settings:
        rows = pd.DataFrame(run.rows_so_far())
        run.note(second_pass=planned(rows[rows.solver != null_solver.ENTRY.name]))
    plan = run.settings["second_pass"]
    chosen = {(each["scaling"], each["solver"], each["lane"]): each["setting"] for each in plan}
    near = {(each["scaling"], each["solver"], each["lane"]) for each in plan if each["longer"]}
    calls = math.ceil(ENOUGH / max(1, len({unit.problem.name for unit in units}) * settings.repeats))
    warm_startable = {(solver.name, str(solver.lane)) for solver in field if solver.warm_start}
    found = []
    for unit in units:
        floor, *tasks = unit.tasks
        tasks = [task for task in tasks if chosen.get((unit.scaling, task.solver, str(task.lane))) == task.setting.text
                 and run.task(task)[0][0]["status"] == Status.OK]
        follows = unit.form.warm_start is not None
        warm = [replace(task, start="warm") for task in tasks if follows and (task.solver, str(task.lane)) in warm_startable]
        longer = [task for task in tasks if (unit.scaling, task.solver, str(task.lane)) in near]
        found.append(SecondPass(unit.run, settings, unit.problem, unit.scaling, unit.repeat, (floor, *tasks), tuple(warm), (floor, *longer), calls))
    return found


def planned(rows: pd.DataFrame) -> list[Planned]:
    """The setting of each solver lane in each scaling: that of the first of PREFERRED that its first answers reach, else the default."""
    rows = rows.assign(timed_gap=math.nan)
    tiers = tier_settings(rows)
    near = near_fastest(at_tiers(rows, tiers))
    found: dict[Who, str] = {}
    for tier in PREFERRED:
        for line in tiers[(tiers.tier == tier) & (tiers.setting != "")].to_dict("records"):
            found.setdefault((line["scaling"], line["solver"], line["lane"]), line["setting"])
    for line in rows[rows.is_default].to_dict("records"):
        found.setdefault((line["scaling"], line["solver"], line["lane"]), line["setting"])
    return [{"scaling": who[0], "solver": who[1], "lane": who[2], "setting": setting, "longer": who in near} for who, setting in found.items()]


def near_fastest(rows: pd.DataFrame) -> set[Who]:
    """The solver lanes between which a decision may have to be made, wrappers left out."""
    rows = rows[(rows.tier == Tier.HIGH) & ~rows.lane.isin([str(lane) for lane in FAMILIES])]
    us = (rows.update_us + rows.solve_us_p50).groupby([rows.scaling, rows.solver, rows.lane]).median()
    best = us.groupby(level=["scaling", "lane"]).transform("min")
    return set(us.index[us <= NEAR * best])
