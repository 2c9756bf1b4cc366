"""What a file of the set `measured` holds, written and read: P, q and c of several programs, and the samples after them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TypedDict

import numpy as np

from bench.problem_files.npz import opened
from bench.problems.protocol import Validation
from piezo_model import IdentificationProblem, ModelStructure, OperatorState
from piezo_model.identification_problem import Excitation
from piezo_model.json_file import decoded


class Meta(TypedDict):
    """What is kept beside the arrays."""

    structure: ModelStructure
    noise_um: float
    excitation: list[Excitation]


def write(path: Path, problems: Sequence[IdentificationProblem], unseen: Validation) -> None:
    """Write programs of one structure and the data that follow; samples are rounded to single precision.

    Of each P the upper triangle is kept, row by row.
    """
    meta = {"structure": unseen.structure.to_dict(), "noise_um": unseen.noise_um,
            "excitation": [asdict(problem.excitation) for problem in problems]}
    with path.open("wb") as file:
        np.savez_compressed(file, meta=np.array(json.dumps(meta)), P=np.array([problem.P[np.triu_indices_from(problem.P)] for problem in problems]),
                            q=np.array([problem.q for problem in problems]), c=np.array([problem.c for problem in problems]),
                            play=unseen.state.play, creep=unseen.state.creep, x=unseen.x.astype(np.float32),
                            y=unseen.y.astype(np.float32))


def read(path: Path, seed: int) -> tuple[IdentificationProblem, Validation]:
    """The program of a seed, counted round by the programs that there are, and the data that follow."""
    with opened(path) as data:
        meta = decoded(str(data["meta"]), Meta)
        k = seed % data["c"].size
        structure, excitation = meta["structure"], meta["excitation"][k]
        P = np.zeros((structure.d, structure.d))
        P[np.triu_indices_from(P)] = data["P"][k]
        x, y = (data[name].astype(np.float64) for name in "xy")
        return (IdentificationProblem(structure, np.triu(P, 1).T + P, data["q"][k], float(data["c"][k]), excitation),
                Validation(structure, OperatorState(data["play"], data["creep"]), x, y, meta["noise_um"]))
