"""The child's side of a calibration: one rung of a solver's ladder on some problems, the answers alone."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Self

from qpsolvers import Problem

from bench.passed.outcome import Outcome
from bench.passed.request import Request, attempt
from bench.passed.said import real
from bench.problem_files.npz import QP_FIELDS
from solvers.arrays import Matrix, Vector
from solvers.protocol import Solver


@dataclass(frozen=True)
class Answer:
    """One answer, or why there is none."""

    failure: str
    message: str
    found: bool = False
    x: Vector | None = None

    @property
    def outcome(self) -> Outcome:
        """As the judge takes it."""
        return Outcome(self.failure, self.message, self.found, self.x)


@dataclass
class Calibrated(Outcome):
    """What came back: an answer a problem, and the processor time of all; no answers where the child failed."""

    answers: list[Answer] = field(default_factory=list)
    spent_s: float = 0.0

    @classmethod
    def of(cls, outcome: Outcome) -> Calibrated:
        """As it came back, or what stands for a child that did not answer."""
        return outcome if isinstance(outcome, Calibrated) else cls(outcome.failure, outcome.message)


@dataclass(frozen=True)
class Calibrate(Request):
    """Answer each program at a rung, as in a race: after a set-up with other data."""

    programs: tuple[tuple[Mapping[str, Any], float, Matrix, Vector], ...]
    """Programs by field with which a solver is set up, each with the constant that its ladder is made for, and the P (d, d) and q (d,) that it
    answers."""
    rung: int

    @classmethod
    def of(cls, forms: Sequence[Any], rung: int) -> Self:
        """The request for certified forms, whose certificates stay here."""
        return cls(tuple(({**{name: getattr(form.qp, name) for name in QP_FIELDS}, "P": first.P, "q": first.q},
                          replace(form, c=first.c).unit, form.qp.P, form.qp.q) for form in forms for first in form.windows), rung)

    def answer(self, cls: type[Solver], first: bool) -> Outcome:
        """Set up, update and solve one after the other."""
        def solved(fields: Mapping[str, Any], c: float, P: Matrix, q: Vector) -> Outcome:
            solver = cls(**cls.ladder(c)[self.rung])
            solver.setup(Problem(**fields))
            solver.update(P=P, q=q)
            x = real(solver.solve())
            return Outcome(found=bool(solver.solution().found), x=x)

        began = time.process_time()
        outcomes = [attempt(partial(solved, *program)) for program in self.programs]
        return Calibrated(answers=[Answer(one.failure, one.message, one.found, one.x) for one in outcomes],
                          spent_s=time.process_time() - began)
