"""Build programs from exported C and run them on samples."""

import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from programs import program

from bench.export.building import write_files
from bench.export.c_source import export
from bench.export.settings import ExportSettings
from piezo_model import HysteresisCreepModel
from solvers.arrays import Vector


def write_sources(folder: Path, model: HysteresisCreepModel, settings: ExportSettings) -> None:
    """Write the export to an existing folder."""
    write_files(folder, export(model, settings))


def build(folder: Path, source: str, compiler: str, *flags: str) -> Path:
    """Build a program of this folder, replay.c or emulated.c, with the export in another."""
    target = folder / source.removesuffix(".c")
    units = sorted(path for path in folder.glob("piezo*.c"))
    words = [program(compiler), "-std=c99", *flags, "-I", folder, Path(__file__).with_name(source), *units]
    subprocess.run([*words, "-o", target, "-lm"], check=True)
    return target


def replay(program: Path, samples: ArrayLike) -> tuple[Vector, tuple[int, ...]]:
    """Drives (N,) for references (N,), with learning (N, 2) beside them the outputs measured before.

    With learning the events, too: hand-overs, refusals, faults of the sensor, numerical faults, late offers, dropped
    blocks.
    """
    source, target = program.with_suffix(".in"), program.with_suffix(".out")
    np.ascontiguousarray(samples, dtype=np.float64).tofile(source)
    done = subprocess.run([program, source, target], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.fromfile(target), tuple(map(int, done.stderr.split()))
