"""What a kill would leave on disk of a race's store, before each of its steps.

A step is an event of Python's audit hook (open, mkdir, rename, remove, chmod, …) with a path of the run. A killed
process leaves its folder as it is then, so that a copy of the folder stands for it, however busy the machine is.
"""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.messages.task import NO_SETTING, Task
from bench.race_table import complete
from bench.store import Run, RunError
from solvers.protocol import Lane

TASKS = [Task("set", f"problem{i}", "scaled", "daqp", Lane.DIRECT, NO_SETTING, d=18) for i in range(2)]


def carry_on(folder: Path) -> None:
    """Start or resume a run, and finish it."""
    try:
        run = Run.open(folder / "run")
    except RunError:
        run = Run.create(folder, {"settings": {}}, "run")
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


def stop_before_each_step(whole: Path, copies: Path) -> None:
    """Finish a run, with a copy of its folder as it was before each step, and then every copy; in a process of its own,
    which keeps the hook."""
    copying = False

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal copying
        if not copying and any(str(argument).startswith(str(whole)) for argument in arguments):
            copying = True
            shutil.copytree(whole, copies / str(len(list(copies.iterdir()))))
            copying = False

    sys.addaudithook(hook)
    carry_on(whole)
    for folder in copies.iterdir():
        carry_on(folder)


if __name__ == "__main__":
    stop_before_each_step(*map(Path, sys.argv[1:]))
