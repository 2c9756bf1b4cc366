"""The programs of a batch race: mixtures of neighbouring windows of recordings, no two alike.

Every simulated actuator under every drive, seen by a model of d = 18 (n = 5, m = 3) and of d = 60 (n = 20, m = 9), gives a family of four
windows. A program is one family's

    P = Σ θ_k P_k,   q = Σ θ_k q_k,   c = Σ θ_k c_k,   θ uniform over θ ≥ 0, Σ θ_k = 1,   lb ≤ x,

the family drawn for each program. Active sets, conditions (1e4 to 1e11) and bounds differ from program to program. They stand in files
outside of the run of which children map copies; which answers are judged only the parent knows, and their optima are proven when
the solvers are done with them.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from qpsolvers import Problem

from bench.passed.progress import Progress
from bench.passed.race_error import RaceError
from bench.problems.paper import DRIVES
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.problems.simulation import Experiment
from bench.store import Run
from piezo_model import plants
from solvers.arrays import Matrix
from solvers.certificate import NotCertified, certify

ORDERS = {18: (5, 3), 60: (20, 9)}
"""n and m of the model by d."""
SET = "batch"
WARM_UP = 64
"""The last of the programs, which are not timed; repeated where a contestant compiles for a size of batch that is larger."""
AT_ONCE = 512
"""Programs that are mixed at once."""
SHARED_MEMORY = Path("/dev/shm")


@dataclass(frozen=True)
class Files:
    """Where the arrays of the programs of one size are; all that a child is told of them."""

    folder: Path
    d: int
    count: int

    @property
    def _shapes(self) -> list[tuple[Path, tuple[int, ...]]]:
        """Each file with the shape of what it holds of one program."""
        shapes = {"P": (self.d, self.d), "q": (self.d,), "lb": (self.d,), "ub": (self.d,)}
        return [(self.folder / f"{name}-{self.d}", shape) for name, shape in shapes.items()]

    def reserve(self) -> None:
        """Make the files with all of their room; OSError where there is less."""
        for path, shape in self._shapes:
            with path.open("xb") as file:
                os.posix_fallocate(file.fileno(), 0, 8 * self.count * math.prod(shape))

    def mapped(self, first: int, last: int, mode: Literal["c", "r+"] = "c") -> tuple[Matrix, ...]:
        """P (n, d, d), q, lb and ub (n, d) of the programs from ``first`` to ``last`` − 1; what is written to copies stays in the process."""
        return tuple(np.memmap(path, np.float64, mode, 8 * first * math.prod(shape), (last - first, *shape)) for path, shape in self._shapes)


@contextmanager
def reserved(sizes: Sequence[int], count: int) -> Iterator[Path]:
    """A folder with the files of ``count`` programs of each size, in shared memory or else where temporary files are; RaceError without room.

    All of the room is taken now: a write into a map of memory that is not there ends the process.
    """
    elsewhere = Path(tempfile.gettempdir())
    for parent in (SHARED_MEMORY, elsewhere):
        with ExitStack() as stack:
            try:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="piezobench-batch-", dir=parent)))
                for d in sizes:
                    Files(folder, d, count).reserve()
            except OSError:
                continue
            yield folder
            return
    megabytes = sum(8 * count * d * (d + 3) for d in sizes) / 1e6
    raise RaceError(f"the programs need {megabytes:.0f} MB in {SHARED_MEMORY} or in {elsewhere}, and neither has the room; "
                    "enlarge one of them, or make the batches smaller with --largest")


class Programs:
    """All programs of one size, at least ``count``, and the proofs of those that are judged.

    The run keeps the families, at most ``limit`` of them, so that a resumed race has the same programs; ``folder`` is one of `reserved`.
    """

    def __init__(self, run: Run, d: int, count: int, seed: int, folder: Path, limit: int | None, progress: Progress) -> None:
        self.files = Files(folder, d, count)
        self._forms = [problem.forms["scaled"] for problem in families(run, d, seed, limit, progress)]
        chance = np.random.default_rng([seed, d])
        self._family = chance.integers(len(self._forms), size=count)
        self._shares = chance.dirichlet(np.ones(1 + len(self._forms[0].windows)), size=count)
        self._proven: dict[int, CertifiedForm | None] = {}
        self._rank = np.random.default_rng().permutation(count)  # by the system's randomness
        progress(f"{count} programs of {d} variables", 0, 1)
        self._write()

    def _write(self) -> None:
        d = self.files.d
        P, q, lb, ub = self.files.mapped(0, self.files.count, "r+")
        for f, form in enumerate(self._forms):
            at = np.flatnonzero(self._family == f)
            matrices = np.array([form.qp.P, *(window.P for window in form.windows)]).reshape(-1, d * d)
            vectors = np.array([form.qp.q, *(window.q for window in form.windows)])
            for few in np.split(at, range(AT_ONCE, at.size, AT_ONCE)):
                P[few] = (self._shares[few] @ matrices).reshape(-1, d, d)
            q[at], lb[at], ub[at] = self._shares[at] @ vectors, form.qp.lb, form.qp.ub
        self._P, self._q = P, q

    def sample(self, first: int, last: int, most: int) -> list[int]:
        """At most so many of the programs from ``first`` to ``last`` − 1; often the same, so that few have to be proven."""
        return sorted(first + int(i) for i in np.argsort(self._rank[first:last])[:most])

    def proven(self, b: int) -> CertifiedForm | None:
        """Program b with its proven optimum; None where there is no proof."""
        if b not in self._proven:
            form, share = self._forms[self._family[b]], self._shares[b]
            qp = Problem(np.array(self._P[b]), np.array(self._q[b]), lb=form.qp.lb, ub=form.qp.ub)
            c = float(share @ [form.c, *(window.c for window in form.windows)])
            try:
                self._proven[b] = replace(form, qp=qp, c=c, certificate=certify(qp, np.array(form.certificate.x)), windows=())
            except NotCertified:  # nothing is judged on what cannot be proven
                self._proven[b] = None
        return self._proven[b]


def families(run: Run, d: int, seed: int, limit: int | None, progress: Progress) -> list[RaceProblem]:
    """A problem with its windows for each actuator and drive, kept in the run."""
    cases = [(plant, drive) for plant in plants.names() for drive in DRIVES][:limit]
    found = []
    for i, (plant, drive) in enumerate(cases):
        progress(f"{plant} under a {drive}, d = {d}", i, len(cases))
        name = f"{plant}-{drive}-{d}"
        path = run.problem_path(SET, name)
        if not path.is_file():
            Experiment(plant, drive, *ORDERS[d], seed=seed + i).problem(SET, name).save(path)
        found.append(run.problem(SET, name))
    return found
