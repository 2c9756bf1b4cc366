"""The accesses of a race to its store, in a process that kills itself before the n-th of them.

A step is an event of Python's audit hook (open, mkdir, rename, remove, chmod, …) with a path of the run.
"""

import os
import signal
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from bench.messages.task import NO_SETTING, Task
from bench.race_table import complete
from bench.store import Run, RunError
from solvers.protocol import Lane

TASKS = [Task("set", f"problem{i}", "scaled", "daqp", Lane.DIRECT, NO_SETTING, d=18) for i in range(2)]


def kill_before_step(n: int, folder: Path) -> None:
    """Kill this process before its n-th step in the folder."""
    steps = count()

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if any(str(argument).startswith(str(folder)) for argument in arguments) and next(steps) == n:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)


def carry_on(folder: Path, settings: dict[str, Any], killed_at: int | None = None) -> None:
    """Start or resume a run, and finish it unless the process is killed."""
    if killed_at is not None:
        kill_before_step(killed_at, folder)
    try:
        run = Run.open(folder / "run")
    except RunError:
        run = Run.create(folder, settings, "run")
    if not run.is_finished():
        run.note(lanes={"daqp": "1"}, absent={})
        for name in ("first", "second"):
            part = run.part(name)
            if part.notes is None:
                with part.appended():
                    for task in TASKS:
                        task = replace(task, problem=f"{task.problem}-{name}")
                        if task.key not in part.rows:
                            known = {**task.columns(), "message": task.problem, "machine": run.note_machine()}
                            part.save(complete(**known), {"solve": np.arange(3)})
                    part.finish({})
        run.finish()
