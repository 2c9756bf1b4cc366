"""Three actuators that were measured, not simulated: P, q and c of their recordings, with the samples that followed.

One NPZ file a recording lies beside this one; README.md says where the recordings come from, under which licence, and how the files
are made again. The operators follow every sample of the first four fifths of a recording. The program of seed s
counts every seventh sample from the s-th on, so that other seeds see other noise of the same sensor; the first half of them makes
its neighbouring window.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from bench.problems.measured.stored import read
from bench.problems.protocol import ProblemSet, RaceProblem, certified

FOLDER = Path(__file__).parent


class Measured(ProblemSet):
    """A stack actuator in a micromanipulator and two scanners of atomic force microscopes."""

    name = "measured"
    origin = "measured elsewhere"
    description = "recordings of three real actuators at the paper's orders (n = 5, m = 3, an offset), the last fifth kept back"

    def __len__(self) -> int:
        """Number of recordings."""
        return len(_files())

    def problems(self) -> Iterator[RaceProblem]:
        """Certify the program of each recording."""
        for path in _files():
            (*neighbours, problem), validation = read(path, self.seed)
            yield certified(self.name, path.stem, problem, validation, neighbours=neighbours)


def _files() -> list[Path]:
    return sorted(FOLDER.glob("*.npz"))
