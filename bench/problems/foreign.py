"""Programs from elsewhere: files of a folder (NPZ, MAT of the Maros–Mészáros set, QPS, MPS, SIF), a test set of
qpbenchmark, or two hundred small programs with bounds, for the tests of any solver: the same bits everywhere, and for
ever.

They have equalities, general rows, ranges, free variables and sparse matrices, which stay sparse; a solver that does
not support them reports it. The raw form is the program as given, the scaled form is equilibrated by powers of two (see
`equilibration`). A program is raced only if its optimum is certified within ``work`` bit operations; the others are in
``left_out`` with the reason. Proofs are cached between races (see `proofs`). Problems saved by this package are
recognised, and their proofs are verified.
"""

from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import ClassVar

import numpy as np
from qpsolvers import Problem
from scipy.sparse import csc_matrix, diags

from bench.problem_files import READERS, ReadProgram, read, suffix_of
from bench.problem_files.npz import opened, unpacked_program
from bench.problem_files.program import checked
from bench.problem_files.qpbenchmark_set import read_test_set
from bench.problems.equilibration import equilibrated
from bench.problems.proofs import isolated, proof, proven, require_size
from bench.problems.protocol import CertifiedForm, ProblemSet, ProblemSetError, RaceProblem
from piezo_model.checks import check
from piezo_model.identification_problem import Scaling
from solvers.certificate import WORK, NotCertified

Source = Callable[[], ReadProgram | RaceProblem]
"""Reads a program, or a problem saved with its proofs, in a process of its own; it is pickled."""
BOXES = Path(__file__).with_name("boxes.npz")
DOCUMENTS = ("", ".py", ".md", ".txt", ".csv", ".html", ".pdf")
"""Suffixes of files that stand beside programs and are not mentioned."""


class ForeignPrograms(ProblemSet):
    """Programs from elsewhere, in the order of their source."""

    takes: ClassVar = {"work": f"bit operations for the proof of one program, {WORK:.0e} by default"}

    def __init__(self, seed: int = 0, **options: str) -> None:
        super().__init__(seed, **options)
        try:
            self.work = float(self.options.get("work", WORK))
            check(self.work >= 1.0, "")
        except ValueError:
            raise ProblemSetError(f"work must be a number of bit operations, not {self.options['work']!r}") from None

    def names(self) -> Sequence[str]:
        """Names of the programs."""
        return [name for name, _ in self.sources()]

    @abstractmethod
    def sources(self) -> Sequence[tuple[str, Source]]:
        """Name and reader of each program."""

    def problems(self) -> Iterator[RaceProblem]:
        """Read, scale and certify, several in parallel; failures are left out with the reason."""
        calls = [(self.name, name, read, self.work) for name, read in self.sources() if name in self.selected]
        with closing(proven(certified, calls)) as made:
            for (_, name, *_), problem in zip(calls, made, strict=True):
                if isinstance(problem, NotCertified):
                    self.left_out[name] = str(problem)
                else:
                    yield problem


def certified(set_name: str, name: str, read: Source, work: float) -> RaceProblem:
    """Read a program and prove its optimum in both scalings, or replay the proofs of a saved problem."""
    source = read()
    if isinstance(source, RaceProblem):
        for wrong in source.wrong_proofs().values():
            raise NotCertified(wrong)
        return replace(source, set_name=set_name, name=name)
    require_size(source.qp)
    qp = checked(source.qp)
    scaled, unit, cost = equilibrated(qp)
    of_scaled = proof(scaled, work=work)
    of_raw = proof(qp, lambda _: unit * np.array(of_scaled.x), work)
    units, ones = (csc_matrix(diags(diagonal)) for diagonal in (unit, np.ones(unit.size)))
    forms: dict[Scaling, CertifiedForm] = {
        "scaled": CertifiedForm(scaled, cost * source.constant, units, of_scaled, cost_unit=cost),
        "raw": CertifiedForm(qp, source.constant, ones, of_raw, cost_unit=1.0),
    }
    return RaceProblem(set_name, name, forms, sense=source.sense)


class Foreign(ForeignPrograms):
    """Every program file of a folder, by name."""

    name = "foreign"
    description = (
        "programs of others from a folder: NPZ, MAT (Maros–Mészáros), QPS, MPS and SIF; rows, equalities, sparse"
    )
    needs: ClassVar = {"folder": "a folder of programs (NPZ, MAT, QPS, MPS, SIF)"}

    def __init__(self, seed: int = 0, **options: str) -> None:
        super().__init__(seed, **options)
        folder = Path(self.options["folder"])
        check(folder.is_dir(), f"{folder}: is not a folder", ProblemSetError)
        there = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
        self.files = [path for path in there if suffix_of(path) in READERS]
        self.left_out = {
            path.name: f"is of an unknown format; programs are read from {', '.join(READERS)}"
            for path in there
            if suffix_of(path) not in (*READERS, *DOCUMENTS)
        }
        check(self.files, f"{folder}: holds no program; programs are read from {', '.join(READERS)}", ProblemSetError)

    def sources(self) -> Sequence[tuple[str, Source]]:
        """The files; the suffix is part of a name that is there twice."""
        names = [path.name[: -len(suffix_of(path))] for path in self.files]
        count = Counter(names)
        return [
            (name if count[name] == 1 else path.name, partial(_of_file, path))
            for name, path in zip(names, self.files, strict=True)
        ]


class QpbenchmarkTestSet(ForeignPrograms):
    """Every problem of a test set, in its order."""

    name = "test_set"
    description = "programs of a test set of qpbenchmark, a Python file with its class"
    needs: ClassVar = {"test_set": "a Python file with the class of a test set of qpbenchmark"}

    def __init__(self, seed: int = 0, **options: str) -> None:
        super().__init__(seed, **options)
        self.path = Path(self.options["test_set"])
        check(self.path.is_file(), f"{self.path}: is not a file", ProblemSetError)

    @cached_property
    def _programs(self) -> list[tuple[str, Problem]]:
        try:
            return isolated(read_test_set, str(self.path.resolve()))
        except NotCertified as error:
            raise ProblemSetError(f"{self.path}: {error}") from None

    def sources(self) -> Sequence[tuple[str, Source]]:
        """The problems of the test set."""
        return [(name, partial(ReadProgram, qp)) for name, qp in self._programs]


class Boxes(ForeignPrograms):
    """The stored programs, by kind: forty of each that ``examples/problem_sets/make_boxes.py`` draws, and forty from
    identification. License of the data: CC BY 4.0."""

    name = "boxes"
    description = "200 small programs with bounds, for a solver's own tests: ill-conditioned, degenerate, scaled"
    takes: ClassVar = {}

    def sources(self) -> Sequence[tuple[str, Source]]:
        """Name of each program, and what makes it."""
        with opened(BOXES) as arrays:
            names = dict.fromkeys(key.partition("/")[0] for key in arrays)
            return [(name, partial(ReadProgram, unpacked_program(arrays, f"{name}/"))) for name in names]


def _of_file(path: Path) -> ReadProgram | RaceProblem:
    """The program of a file, or the problem saved in it."""
    if suffix_of(path) == ".npz":
        with opened(path) as arrays:
            if "meta" in arrays:
                return RaceProblem.load(path)
    return read(path)
