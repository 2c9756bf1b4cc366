"""A row, what is kept of a task; every kind of race adds its own columns to those that say who did what."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any

from bench.passed.task import Task

Row = dict[str, Any]


def who(task: Task, d: int, asked: Mapping[str, Any] | None = None) -> Row:
    """The columns that every row begins with, for a problem of d variables and the settings that the solver was given."""
    return {"task": task.key, "problem_set": task.problem_set, "problem": task.problem, "d": d, "solver": task.solver,
            "lane": str(task.lane), "setting": task.setting.text, "rung": task.setting.rung, "is_default": task.setting.is_default,
            "scaling": task.scaling, "start": task.start, "repeat": task.repeat, "host": os.uname().nodename,
            "settings": json.dumps(dict(asked or task.more), default=str)}
