"""Embedded C of many authors built by one compiler with one set of flags, and loaded.

A library is built once for each generator, version and shape of problem and kept in a folder for temporary files. Every
load takes a copy of its own, since embedded solvers keep their problem in static memory.
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
TIMED = (HERE / "timed_loop.c", CORE / "clock.c")
"""The C that times what is built."""

_found = shutil.which("gcc") or shutil.which("clang")
if _found is None:
    raise ImportError("there is no C compiler on this machine; apt-get install gcc brings one on Debian")
COMPILER = _found
FLAGS = ("-O3", "-march=native", "-ffp-contract=fast")
"""What users of generated code are told to use, plus the machine's own instructions, for all alike."""
_LINK = ("-shared", "-fPIC", "-w", "-Wl,-Bsymbolic", "-Wl,-z,defs")


class BuildError(RuntimeError):
    """Generated C does not build here; the message is one sentence."""


class Sources(NamedTuple):
    """What a generator wrote: C files, and the options -I and -D that they want."""

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
    """Load what ``generate`` writes into a folder, built before for the same key or now.

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


def run(command: Iterable[str | Path], folder: Path) -> None:
    """Run a program that builds; BuildError says how it failed."""
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = done.stderr.strip() or done.stdout.strip()
        first = next((line for line in said.splitlines() if "error" in line.lower()), said[:200])
        raise BuildError(f"{Path(words[0]).name} does not build the embedded solver: {first}")


def _compile(sources: Sources, folder: Path, target: Path) -> None:
    run(
        [
            COMPILER,
            *FLAGS,
            *_LINK,
            f"-I{folder}",
            f"-I{HERE}",
            *sources.options,
            *sources.files,
            *TIMED,
            "-o",
            target,
            "-lm",
        ],
        folder,
    )


def _cache() -> Path:
    """The folder of built libraries, which nobody else can put a library into."""
    folder = Path(tempfile.gettempdir()) / f"piezobench-codegen-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise BuildError(f"{folder} is not a folder that this user alone can write to, so no library is loaded from it")
    return folder
