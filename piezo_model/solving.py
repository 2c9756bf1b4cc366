"""Solution of a program by any registered solver."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

import solvers
from solvers.arrays import Vector

STEPPED = "projected_difference"
"""The solver that the core runs itself, one step for each sample."""


def solved(
    solver: str,
    options: Mapping[str, Any] | None,
    program: solvers.Problem,
    start: Vector | None = None,
    c: float = 1.0,
) -> Vector:
    """Answer (d,) of a solver, or NaN if it finds none; warm-started from ``start``, if any and if the solver can be.

    The setup sees different data of the same structure, so that the solution is computed by the solve alone.

    The ``options`` are lane, settings and ``setting``, the text of a rung of the solver's ladder
    (:func:`solvers.protocol.setting_text`) or of its default use; without ``setting``, the tightest rung that succeeds.

    Examples
    --------
    >>> from qpsolvers import Problem
    >>> solved("box_active_set", None, Problem(np.eye(1), np.array([-2.0]), lb=np.zeros(1))).tolist()
    [2.0]
    """
    for engine in _candidates(solver, c, **(options or {})):
        engine.setup(solvers.Problem(0.5 * program.P, np.zeros_like(program.q), lb=program.lb, ub=program.ub))
        engine.update(program.P, program.q)
        answer = np.array(engine.solve(warm_start=start if engine.warm_startable else None))
        if engine.solution().found and np.all(np.isfinite(answer)):
            return answer
    return np.full_like(answer, np.nan)


def _candidates(
    solver: str, c: float, lane: str | None = None, setting: str | None = None, **settings: Any
) -> Iterator[solvers.Solver]:
    """The solver at the given setting, or at each rung of its ladder, beginning with the tightest."""
    cls = solvers.find(solver, lane).load()
    for rung in cls.ladder(c)[::-1] if setting is None else [cls.at(setting, c)]:
        yield cls(**{**rung, **settings})


def require_setting(setting: str | None, solver: str, lane: str | None) -> None:
    """Raise ValueError if the solver has no such setting; not checked if its library is not installed."""
    with suppress(ImportError):
        if setting is not None:
            solvers.find(solver, lane).load().at(setting, 1.0)


def step_ratio(options: Mapping[str, Any] | None) -> float:
    """Step of the projected difference equation as a share of the stability limit; ValueError if it is invalid."""
    engine = solvers.get(STEPPED, **{name: value for name, value in (options or {}).items() if name != "setting"})
    return float(engine.settings.get("step_ratio", 0.5))
