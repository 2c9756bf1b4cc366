"""Programs of others, from a folder of files: NPZ, MAT as the Maros–Mészáros set is converted to, QPS and MPS.

They have equalities, general rows, ranges, free variables and sparse matrices, which stay sparse; what a solver cannot take
is reported as unsupported. Raw is the file's program; scaled is equilibrated by powers of two (see `equilibration`). A
program is raced only where its optimum is certified within ``limit_s`` seconds; the others are in ``left_out`` with the
reason. Problems that were saved here are recognised, and their own proofs are replayed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.sparse import csc_matrix, diags, identity

from bench.problem_files import READERS, ProblemFileError, read
from bench.problem_files.npz import opened
from bench.problems.certifying import Prover, both_proofs
from bench.problems.equilibration import equilibrated
from bench.problems.protocol import CertifiedForm, ProblemSet, ProblemSetError, RaceProblem
from solvers.certificate import NotCertified, verify


class Foreign(ProblemSet):
    """Every file of a folder that holds a program, in the order of their names."""

    name = "foreign"
    description = "programs of others from a folder: NPZ, MAT (Maros–Mészáros), QPS and MPS; rows, equalities, sparse"
    needs: ClassVar = {"folder": "a folder of programs (NPZ, MAT, QPS, MPS)"}
    takes: ClassVar = {"limit_s": "seconds for the proof of one program, 60 by default"}

    def __init__(self, seed: int = 0, **options: str) -> None:
        super().__init__(seed, **options)
        folder = Path(self.options["folder"])
        if not folder.is_dir():
            raise ProblemSetError(f"{folder}: is not a folder")
        self.files = sorted(path for path in folder.iterdir() if path.suffix.lower() in READERS and path.is_file())
        if not self.files:
            raise ProblemSetError(f"{folder}: holds no program; one is in a file {', '.join(READERS)}")
        try:
            self.limit_s = float(self.options.get("limit_s", "60"))
        except ValueError:
            raise ProblemSetError(f"limit_s is {self.options['limit_s']!r} and no number of seconds") from None

    def __len__(self) -> int:
        """Number of files."""
        return len(self.files)

    def problems(self) -> Iterator[RaceProblem]:
        """Read, scale and certify; whatever fails is left out with the reason."""
        same = Counter(path.stem for path in self.files)
        with Prover(self.limit_s) as prover:
            for path in self.files:
                name = path.stem if same[path.stem] == 1 else path.name
                try:
                    yield self._saved(path, name, prover) or self._certified(path, name, prover)
                except (ProblemFileError, NotCertified) as error:
                    self.left_out[name] = str(error)

    def _saved(self, path: Path, name: str, prover: Prover) -> RaceProblem | None:
        """A problem that was saved here, if it is one and its proofs hold."""
        if path.suffix.lower() != ".npz":
            return None
        with opened(path) as arrays:
            if "meta" not in arrays:
                return None
        problem = RaceProblem.load(path)
        prover.prove(replay, problem)
        return replace(problem, set_name=self.name, name=name)

    def _certified(self, path: Path, name: str, prover: Prover) -> RaceProblem:
        program = read(path)
        scaled = equilibrated(program.qp)
        raw_proof, proof = prover.prove(both_proofs, program.qp, scaled.qp, scaled.unit)
        return RaceProblem(self.name, name, {
            "scaled": CertifiedForm(scaled.qp, scaled.cost * program.constant, csc_matrix(diags(scaled.unit)), proof,
                                    cost_unit=scaled.cost),
            "raw": CertifiedForm(program.qp, program.constant, csc_matrix(identity(scaled.unit.size, dtype=np.float64)),
                                 raw_proof, cost_unit=1.0)})


def replay(problem: RaceProblem) -> None:
    """Replay the proof of every form."""
    for form in problem.forms.values():
        verify(form.qp, form.certificate)
