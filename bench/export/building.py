"""The exported C built and run on this machine: with any compiler, replayed over recorded samples, counted by
callgrind; its sources in a folder that is there whole or not at all: written beside the target, then renamed to it."""

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from bench.export.c_source import export, render
from bench.export.settings import ExportError, ExportSettings
from piezo_model import HysteresisCreepModel
from solvers.arrays import Vector

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
EXACT = ("-ffp-contract=off",)
"""No fused multiplication and addition, so that every compiler and machine gives the same numbers to rounding of
sums."""
FAST = ("-O3", "-march=native", "-ffp-contract=fast")
COUNTABLE = ("-O3", "-march=x86-64-v3", "-ffp-contract=fast")
"""What valgrind understands: no AVX-512."""
PROGRAMS = {"replay.c": "replay.c.jinja"}


def tool(*names: str, package: str = "") -> str:
    """Path of the first of these programs that is here; ExportError names the Debian package where none is."""
    for name in names:
        if found := shutil.which(name):
            return found
    raise ExportError(
        f"there is no {' or '.join(names)} on this machine; apt-get install {package or names[0]} brings it on Debian"
    )


def write_sources(folder: Path, model: HysteresisCreepModel, settings: ExportSettings) -> None:
    """Write the export and the programs that measure it."""
    write_files(folder, {**export(model, settings), **render(model, settings, files=PROGRAMS)})


def units(folder: Path) -> list[str]:
    """What is to be compiled beside a program."""
    return sorted(path.name for path in folder.glob("piezo*.c"))


def compiled(compiler: str, words: Sequence[str], folder: Path, what: str) -> None:
    """Call a compiler in a folder; ExportError says what it does not build, with the first error."""
    # where what a compiler leaves that is killed goes with the folder
    scratch = {**os.environ, "TMPDIR": str(folder.resolve())}
    done = subprocess.run([compiler, *words], cwd=folder, env=scratch, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        first = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
        raise ExportError(f"{compiler} does not build {what}: {first}")


def build(folder: Path, program: str, compiler: str, flags: Sequence[str]) -> Path:
    """Build ``program`` (replay or loop) in a folder of :func:`write_sources`; ExportError where that fails."""
    target = folder / f"{program}-{Path(compiler).name}{''.join(flags).replace('/', '_').replace('=', '_')}"[:200]
    posix = ("-D_POSIX_C_SOURCE=200809L",) if program == "replay" else ("-pthread",)
    compiled(
        compiler,
        ["-std=c99", *posix, *flags, f"{program}.c", *units(folder), "-o", str(target), "-lm"],
        folder,
        "the export",
    )
    return target


@dataclass(frozen=True)
class StepTime:
    """What a step takes, ns, and the memory of an axis, bytes."""

    fastest_ns: float
    with_learning_ns: float
    """The same with a step's share of the learning."""
    axis_bytes: int


@dataclass(frozen=True)
class Replay:
    """What a replay gave."""

    x: Vector
    """Drives. Shape (N,)."""
    events: tuple[int, ...]
    """With learning: hand-overs, refusals, faults of the sensor, numerical faults, late offers, dropped blocks."""
    time: StepTime | None


def replay(program: Path, samples: ArrayLike, repetitions: int = 0) -> Replay:
    """Run the exported step, a program of :func:`build`, over samples, and so many times more to time it.

    Samples are references (N,), with learning (N, 2) beside them the outputs measured before.
    """
    samples = np.ascontiguousarray(samples, dtype=np.float64)
    source, target = program.with_suffix(".in"), program.with_suffix(".out")
    samples.tofile(source)
    words = [str(program), str(source), str(target), *([str(repetitions)] if repetitions else [])]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ExportError(f"the exported C ended with status {done.returncode}: {done.stderr.strip()[:400]}")
    time = None
    if repetitions:
        fastest, both, size = done.stdout.split()
        time = StepTime(float(fastest), float(both), int(size))
    return Replay(np.fromfile(target), tuple(int(word) for word in done.stderr.split()), time)


def instructions_per_step(program: Path, samples: ArrayLike, function: str = "piezo_step") -> float:
    """Instructions of a function and of all that it calls, a step, counted by valgrind's callgrind over a replay
    (``COUNTABLE`` build)."""
    samples = np.ascontiguousarray(samples, dtype=np.float64)
    source, target, counts = (program.with_suffix(suffix) for suffix in (".in", ".out", ".callgrind"))
    samples.tofile(source)
    done = subprocess.run(
        [
            tool("valgrind"),
            "--tool=callgrind",
            f"--toggle-collect={function}",
            f"--callgrind-out-file={counts}",
            str(program),
            str(source),
            str(target),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"Collected : (\d+)", done.stderr)
    if done.returncode != 0 or found is None:
        raise ExportError(f"valgrind did not count: {done.stderr.strip()[-200:]}")
    return int(found[1]) / samples.shape[0]


def write_folder(target: Path, files: Mapping[str, str]) -> None:
    """Write text files into a new or empty folder.

    ExportError where the target is a file or a folder with something in it, or its folder does not exist or may not be
    written to.
    """
    if target.is_symlink() and not target.exists():
        raise ExportError(f"{target}: is a link to nothing")
    target = target.resolve()
    if target.exists() and not target.is_dir():
        raise ExportError(f"{target}: is a file; name a new folder")
    try:
        first = min(target.iterdir(), default=None) if target.exists() else None
    except OSError as error:
        raise ExportError(f"{target}: cannot be read ({error.strerror})") from None
    if first is not None:
        raise ExportError(f"{target}: the folder holds {first.name} already; name a new or an empty folder")
    if not target.parent.is_dir():
        raise ExportError(f"{target}: the folder {target.parent} does not exist")
    if not os.access(target.parent, os.W_OK):
        raise ExportError(f"{target}: nothing may be written into the folder {target.parent}")
    try:
        _write_beside(target, files)
    except OSError as error:
        raise ExportError(f"{target}: cannot be written ({error.strerror or error})") from None


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write text files into a folder that is there, some into folders in it."""
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def _write_beside(target: Path, files: Mapping[str, str]) -> None:
    temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        write_files(temporary, files)
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o777 & ~mask)  # mkdtemp is private; an ordinary new folder is not
        temporary.rename(target)  # an empty folder gives way, one that was filled meanwhile does not
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
