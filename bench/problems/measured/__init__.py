"""Three measured actuators: P, q and c of their recordings, and the samples that followed.

Each recording has an NPZ file in this folder; README.md states the sources, the licences and how to make the files. The
operators follow every sample of the first four fifths of a recording. The program of seed s uses every seventh sample
from the s-th on, so that other seeds have other noise of the same sensor; the first half of these samples is its
neighbouring window.
"""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from bench.problem_files.npz import opened
from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from piezo_model import IdentificationProblem, ModelStructure, OperatorState
from piezo_model.identification_problem import Excitation
from piezo_model.json_file import convert

FOLDER = Path(__file__).parent


class Measured(ProblemSet):
    """A stack actuator in a micromanipulator and two scanners of atomic force microscopes."""

    name = "measured"
    origin = "measured elsewhere"
    description = (
        "recordings of three real actuators at the paper's orders (n = 5, m = 3, an offset), the last fifth held out"
    )

    files: ClassVar = {path.stem: path for path in sorted(FOLDER.glob("*.npz"))}

    def names(self) -> Sequence[str]:
        """Names of the recordings."""
        return [*self.files]

    def problems(self) -> Iterator[RaceProblem]:
        """Certify the program of each recording."""
        for name in filter(self.selected.__contains__, self.files):
            (*neighbours, problem), validation = read(self.files[name], self.seed)
            yield certified(self.name, name, problem, validation, neighbours=neighbours)


def read(path: Path, seed: int) -> tuple[list[IdentificationProblem], Validation]:
    """The programs of a seed, modulo the number of phases, the longest window last, and the unseen data.

    A file has the windows of each phase, and of each P the upper triangle, row by row.
    """
    with opened(path) as data:
        meta, phase = json.loads(str(data["meta"])), seed % len(data["c"])
        structure = convert(meta["structure"], ModelStructure)
        excitations = convert(meta["excitation"][phase], list[Excitation])
        rows, columns = np.triu_indices(structure.d)
        P = np.zeros((len(excitations), structure.d, structure.d))
        P[:, rows, columns] = P[:, columns, rows] = data["P"][phase]
        programs = [
            IdentificationProblem(structure, *of_window)
            for of_window in zip(P, data["q"][phase], data["c"][phase].tolist(), excitations, strict=True)
        ]
        x, y = (data[name].astype(np.float64) for name in "xy")
        return programs, Validation(structure, OperatorState(data["play"], data["creep"]), x, y, meta["noise_um"])
