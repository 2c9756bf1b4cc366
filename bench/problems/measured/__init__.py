"""Three actuators that were measured, not simulated: P, q and c of their recordings, with the samples that followed.

One NPZ file a recording lies beside this one; README.md says where the recordings come from, under which licence, and
how the files are made again. The operators follow every sample of the first four fifths of a recording. The program of
seed s counts every seventh sample from the s-th on, so that other seeds see other noise of the same sensor; the first
half of them makes its neighbouring window.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TypedDict

import numpy as np

from bench.problem_files.npz import opened
from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from piezo_model import IdentificationProblem, ModelStructure, OperatorState
from piezo_model.identification_problem import Excitation
from piezo_model.json_file import decoded

FOLDER = Path(__file__).parent


class Measured(ProblemSet):
    """A stack actuator in a micromanipulator and two scanners of atomic force microscopes."""

    name = "measured"
    origin = "measured elsewhere"
    description = (
        "recordings of three real actuators at the paper's orders (n = 5, m = 3, an offset), the last fifth kept back"
    )

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


class Meta(TypedDict):
    """What is kept beside the arrays."""

    structure: ModelStructure
    noise_um: float
    excitation: list[list[Excitation]]


def write(path: Path, programs: Sequence[Sequence[IdentificationProblem]], unseen: Validation) -> None:
    """Write programs of one structure, for each phase its windows, and the data that follow, rounded to single
    precision.

    Of each P the upper triangle is kept, row by row.
    """
    meta = {
        "structure": unseen.structure.to_dict(),
        "noise_um": unseen.noise_um,
        "excitation": [[asdict(problem.excitation) for problem in windows] for windows in programs],
    }
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            meta=np.array(json.dumps(meta)),
            P=np.array([[problem.P[np.triu_indices_from(problem.P)] for problem in windows] for windows in programs]),
            q=np.array([[problem.q for problem in windows] for windows in programs]),
            c=np.array([[problem.c for problem in windows] for windows in programs]),
            play=unseen.state.play,
            creep=unseen.state.creep,
            x=unseen.x.astype(np.float32),
            y=unseen.y.astype(np.float32),
        )


def read(path: Path, seed: int) -> tuple[list[IdentificationProblem], Validation]:
    """The programs of a seed, counted round by the phases that there are, the one of the longest window last, and the
    data that follow."""
    with opened(path) as data:
        meta = decoded(str(data["meta"]), Meta)
        structure, phase = meta["structure"], seed % len(data["c"])
        programs = []
        for P, q, c, excitation in zip(*(data[name][phase] for name in "Pqc"), meta["excitation"][phase], strict=True):
            upper = np.zeros((structure.d, structure.d))
            upper[np.triu_indices_from(upper)] = P
            programs.append(IdentificationProblem(structure, np.triu(upper, 1).T + upper, q, float(c), excitation))
        x, y = (data[name].astype(np.float64) for name in "xy")
        return programs, Validation(structure, OperatorState(data["play"], data["creep"]), x, y, meta["noise_um"])
