"""Programs of a test set of qpbenchmark, read from its class, so that whoever has one there can race it here as it
is."""

from collections.abc import Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import ClassVar

from qpsolvers import Problem

from bench.problem_files import ReadProgram
from bench.problem_files.program import about, checked
from bench.problem_files.qpbenchmark_set import read_test_set
from bench.problems.foreign import ForeignPrograms, Source
from bench.problems.protocol import ProblemSetError
from bench.processes.forked_child import ForkedChild
from piezo_model.child_process import LateError, LostError

LIMIT_S = 600.0
"""For all of a test set to be made; some download their programs."""


class QpbenchmarkTestSet(ForeignPrograms):
    """Every problem of a test set, in its order."""

    name = "test_set"
    description = "programs of a test set of qpbenchmark, a Python file with its class"
    needs: ClassVar = {"test_set": "a Python file with the class of a test set of qpbenchmark"}

    def __init__(self, seed: int = 0, **options: str) -> None:
        super().__init__(seed, **options)
        self.path = Path(self.options["test_set"])
        if not self.path.is_file():
            raise ProblemSetError(f"{self.path}: is not a file")

    @cached_property
    def _programs(self) -> list[tuple[str, Problem]]:
        with ForkedChild() as child:
            try:
                found = child.call(LIMIT_S, read_test_set, str(self.path.resolve()))
            except LateError:
                found = f"was not read within {LIMIT_S:g} s"
            except LostError as error:
                found = f"ended the process that read it with {error}"
        if isinstance(found, str):
            raise ProblemSetError(f"{self.path}: {found}")
        if not found:
            raise ProblemSetError(f"{self.path}: holds no problem")
        return found

    def sources(self) -> Sequence[tuple[str, Source]]:
        """The problems."""
        return [(name, partial(_checked, f"{self.path}: {name}", qp)) for name, qp in self._programs]


def _checked(where: str, qp: Problem) -> ReadProgram:
    with about(where):
        return ReadProgram(checked(qp))
