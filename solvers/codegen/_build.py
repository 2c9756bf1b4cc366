"""Builds embedded C of many authors with one compiler and one set of flags, and loads it.

A library is built once for each generator, version and shape of problem and cached in the folder of temporary files.
Each load takes its own copy, since embedded solvers keep their problem in static memory.
"""

import ctypes
import functools
import hashlib
import os
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
CORE = HERE.parent / "core"
KERNEL = HERE.parent / "kernel"

_found = shutil.which("gcc") or shutil.which("clang")
if _found is None:
    raise ImportError("there is no C compiler on this machine; on Debian, apt-get install gcc")
COMPILER = _found
FLAGS = ("-O3", "-march=native", "-ffp-contract=fast")
"""The flags that authors of generators recommend, with all instructions of this processor."""
_LINK = ("-shared", "-fPIC", "-w", "-Wl,-Bsymbolic", "-Wl,-z,defs")


class BuildError(RuntimeError):
    """Generated C does not compile; the message is one sentence."""


class Sources(NamedTuple):
    """Output of a generator: C files, and the options -I and -D that they need."""

    files: tuple[Path, ...]
    options: tuple[str, ...] = ()


@functools.cache
def built_with() -> str:
    """Compiler, its version and the flags."""
    version = subprocess.run(
        [COMPILER, "-dumpfullversion", "-dumpversion"], capture_output=True, text=True, check=True
    ).stdout
    return f"{Path(COMPILER).name} {version.strip()} {' '.join(FLAGS)}"


def library(key: Iterable[bytes], generate: Callable[[Path], Sources]) -> ctypes.CDLL:
    """Load the library of the sources that ``generate`` writes; it is built once for each key.

    Raises
    ------
    BuildError
        The compiler refuses the sources, or the folder for temporary files is not ours alone.
    """
    digest = hashlib.sha256(b"\0".join((built_with().encode(), *key))).hexdigest()[:24]
    cache = _cache()
    kept = cache / f"{digest}.so"
    if not kept.exists():
        with tempfile.TemporaryDirectory(dir=cache) as name:
            folder = Path(name)
            _compile(generate(folder), folder, folder / kept.name)
            (folder / kept.name).replace(kept)  # in one step: another process may be building the same
    with tempfile.NamedTemporaryFile(dir=cache, suffix=".so") as copy:
        shutil.copyfile(kept, copy.name)
        return ctypes.CDLL(copy.name)


def _compile(sources: Sources, folder: Path, target: Path) -> None:
    includes = [*(f"-I{each}" for each in (folder, HERE)), *sources.options, f"-I{KERNEL}", f"-I{CORE}"]
    command = [COMPILER, *FLAGS, *_LINK, *includes, *map(str, sources.files), "-o", str(target), "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        first = next((line for line in done.stderr.splitlines() if "error" in line.lower()), done.stderr[:200])
        raise BuildError(f"{Path(COMPILER).name} does not build the embedded solver: {first}")


def _cache() -> Path:
    """The folder of built libraries, to which no other user can write."""
    folder = Path(tempfile.gettempdir()) / f"piezobench-codegen-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise BuildError(f"{folder} is not a folder that this user alone can write to, so no library is loaded from it")
    return folder
