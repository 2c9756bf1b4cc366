"""Programs of others, from a folder of files: NPZ, MAT as the Maros–Mészáros set is converted to, QPS and MPS.

They have equalities, general rows, ranges, free variables and sparse matrices, which stay sparse; what a solver cannot
take is reported as unsupported. Raw is the file's program; scaled is equilibrated by powers of two (see
`equilibration`). A program is raced only where its optimum is certified within ``work`` bit operations; the others are
in ``left_out`` with the reason. Proofs are kept between races (see `proof_cache`). Problems that were saved here are
recognised, and their own proofs are replayed.
"""

from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.sparse import csc_matrix, diags, identity

from bench.problem_files import READERS, ProblemFileError, ReadProgram, read
from bench.problem_files.npz import opened
from bench.problems import proof_cache
from bench.problems.certifying import ProverLost, both_proofs, prove, proven, require_size
from bench.problems.equilibration import equilibrated
from bench.problems.protocol import CertifiedForm, ProblemSet, ProblemSetError, RaceProblem
from bench.processes.forked_child import ForkedChild
from solvers.certificate import WORK, NotCertified, verify

Source = Callable[[], ReadProgram | RaceProblem]
"""Reads a program, or a problem that was saved with its proofs."""


class ForeignPrograms(ProblemSet):
    """Programs that are not made here, in the order in which they come."""

    takes: ClassVar = {"work": f"bit operations for the proof of one program, {WORK:.0e} by default"}

    def __init__(self, seed: int = 0, **options: str) -> None:
        super().__init__(seed, **options)
        try:
            self.work = float(self.options.get("work", WORK))
        except ValueError:
            raise ProblemSetError(f"work is {self.options['work']!r} and no number of bit operations") from None

    def __len__(self) -> int:
        """Number of programs."""
        return len(self.sources())

    @abstractmethod
    def sources(self) -> Sequence[tuple[str, Source]]:
        """Name of each program, and what reads it."""

    def problems(self) -> Iterator[RaceProblem]:
        """Read, scale and certify, several at once; whatever fails is left out with the reason."""
        sources = self.sources()
        with closing(proven(self._made, sources)) as made:
            for (name, _), found in zip(sources, made, strict=True):
                if isinstance(found, str):
                    self.left_out[name] = found
                else:
                    yield found

    def _made(self, child: ForkedChild, source: tuple[str, Source]) -> RaceProblem | str:
        """The problem, or why there is none."""
        name, read = source
        try:
            given = read()
            if isinstance(given, ReadProgram):
                return self._certified(name, given, child)
            prove(child, replay, given)
            return replace(given, set_name=self.name, name=name)
        except (ProblemFileError, NotCertified) as error:
            return str(error)

    def _certified(self, name: str, program: ReadProgram, child: ForkedChild) -> RaceProblem:
        require_size(program.qp)
        scaled = equilibrated(program.qp)
        key = proof_cache.key([program.qp, scaled.qp], self.work)
        proofs = proof_cache.load(key)
        if proofs is None:
            try:
                proofs = list(prove(child, both_proofs, program.qp, scaled.qp, scaled.unit, self.work))
            except ProverLost:
                raise
            except NotCertified as error:
                proof_cache.save(key, [], str(error))
                raise
            proof_cache.save(key, proofs)
        raw_proof, proof = proofs
        return RaceProblem(
            self.name,
            name,
            {
                "scaled": CertifiedForm(
                    scaled.qp,
                    scaled.cost * program.constant,
                    csc_matrix(diags(scaled.unit)),
                    proof,
                    cost_unit=scaled.cost,
                ),
                "raw": CertifiedForm(
                    program.qp,
                    program.constant,
                    csc_matrix(identity(scaled.unit.size, dtype=np.float64)),
                    raw_proof,
                    cost_unit=1.0,
                ),
            },
        )


class Foreign(ForeignPrograms):
    """Every file of a folder that holds a program, in the order of their names."""

    name = "foreign"
    description = "programs of others from a folder: NPZ, MAT (Maros–Mészáros), QPS and MPS; rows, equalities, sparse"
    needs: ClassVar = {"folder": "a folder of programs (NPZ, MAT, QPS, MPS)"}

    def __init__(self, seed: int = 0, **options: str) -> None:
        super().__init__(seed, **options)
        folder = Path(self.options["folder"])
        if not folder.is_dir():
            raise ProblemSetError(f"{folder}: is not a folder")
        self.files = sorted(path for path in folder.iterdir() if path.suffix.lower() in READERS and path.is_file())
        if not self.files:
            raise ProblemSetError(f"{folder}: holds no program; one is in a file {', '.join(READERS)}")

    def sources(self) -> Sequence[tuple[str, Source]]:
        """The files."""
        same = Counter(path.stem for path in self.files)
        return [(path.stem if same[path.stem] == 1 else path.name, partial(_of_file, path)) for path in self.files]


def _of_file(path: Path) -> ReadProgram | RaceProblem:
    """The program of a file, or the problem that was saved in it."""
    if path.suffix.lower() == ".npz":
        with opened(path) as arrays:
            saved = "meta" in arrays
        if saved:
            return RaceProblem.load(path)
    return read(path)


def replay(problem: RaceProblem) -> None:
    """Replay the proof of every form."""
    for form in problem.forms.values():
        verify(form.qp, form.certificate)
