"""A row, what is kept of a task; every kind of race adds its own columns to those that say who did what."""

from __future__ import annotations

import json
from typing import Any

from bench.passed.task import Task

Row = dict[str, Any]


def who(task: Task, d: int) -> Row:
    """The columns that every row begins with, for a problem of d variables."""
    return {"task": task.key, "problem_set": task.problem_set, "problem": task.problem, "d": d, "solver": task.solver,
            "lane": str(task.lane), "tier": str(task.tier), "scaling": task.scaling,
            "settings": json.dumps(dict(task.settings)), "repeat": task.repeat}
