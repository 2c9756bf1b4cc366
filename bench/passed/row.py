"""A row, what is kept of a task; every kind of race adds its own columns to those that say who did what."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from bench.passed.task import Task

Row = dict[str, Any]


def who(task: Task, d: int, asked: Mapping[str, Any] | None = None) -> Row:
    """The columns that every row begins with but the tier, for a problem of d variables and the settings that the solver was given."""
    return {"task": task.key, "problem_set": task.problem_set, "problem": task.problem, "d": d, "solver": task.solver,
            "lane": str(task.lane), "rung": task.rung, "scaling": task.scaling,
            "settings": json.dumps(dict(asked or task.settings), default=str), "repeat": task.repeat}


def for_tiers(task: Task, rows: Iterable[Row]) -> list[Row]:
    """The rows once for each tier that the task serves."""
    return [{**row, "tier": str(tier)} for row in rows for tier in task.tiers]
