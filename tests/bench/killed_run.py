"""Write a run in a process that is killed at its n-th step on disk, for n = 0, 1, …, and carry on in another.

A step is whatever Python reports to an audit hook (open, mkdir, rename, remove, chmod, …) with a path of the run in it;
the process kills itself just before. Called with an empty folder, this prints one JSON line for each n, the last one
for the process that came through.
"""

import json
import os
import signal
import sys
import traceback
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from bench.derived.table import ONESHOT
from bench.messages.task import NO_SETTING, Task
from bench.store import Run, RunError, Schema
from solvers.protocol import Lane

TASKS = [Task("set", f"problem{i}", "scaled", "daqp", Lane.DIRECT, NO_SETTING, d=18) for i in range(2)]

MACHINE = {
    "processor": "abacus",
    "cores": 1,
    "system": "",
    "python": "",
    "core": "",
    "versions": {},
    "load_at_start": [],
    "warnings": [],
}
PLAIN = Schema("rows.parquet", ONESHOT.columns, ("problem",))


def row(task: Task) -> dict[str, Any]:
    """A row that differs from task to task."""
    return {**task.columns(), "status": "ok", "message": task.problem, "cost_gap": float("nan")}


def carry_on(folder: Path) -> None:
    """What a race does with its store."""
    try:
        run = Run.open(folder / "run")
    except RunError:
        run = Run.create(folder, {"race": "none", "settings": {}, "machine": MACHINE}, "run")
    if not run.is_finished(PLAIN):
        run.note(field={"daqp": "1"}, absent={})
        for task in TASKS:
            if not run.is_done(task):
                run.save(task, [row(task)], {"solve": np.arange(3)})
        run.finish(PLAIN)


def look(folder: Path) -> None:
    """Say what a run holds."""
    run = Run(folder / "run")
    tasks = run.rows(PLAIN).task.tolist()
    print(
        json.dumps(
            {
                "tasks": tasks,
                "settings": run.settings,
                "visible": sorted(
                    str(path.relative_to(run.path)) for path in run.path.rglob("[!.]*") if ".tasks" not in path.parts
                ),
            }
        ),
        flush=True,
    )


def die_before_step(n: int, folder: Path) -> None:
    """Kill this process at its n-th step in the folder."""
    steps = count()

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if any(str(argument).startswith(str(folder)) for argument in arguments) and next(steps) == n:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)


def in_child(work: Callable[[], None]) -> int:
    """How a process that does the work ends."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    try:
        work()
    except BaseException:  # the parent's own code must not run on in the child
        traceback.print_exc()
        os._exit(1)
    os._exit(0)


def main(folder: Path) -> None:
    """Kill at every step until none is left."""
    for n in count():
        place = folder / str(n)
        place.mkdir()

        def killed(n: int = n, place: Path = place) -> None:
            die_before_step(n, place)
            carry_on(place)

        def resumed(place: Path = place) -> None:
            carry_on(place)
            look(place)

        status = in_child(killed)
        assert status in (0, -signal.SIGKILL), (n, status)
        assert in_child(resumed) == 0, n
        if status == 0:
            return


if __name__ == "__main__":
    main(Path(sys.argv[1]))
