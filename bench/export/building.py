"""The exported source compiled on this machine, and written into a folder that is there whole or not at all."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.export.settings import ExportError

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
EXACT = ("-ffp-contract=off",)
"""No fused multiplication and addition, so that every compiler and machine gives the same numbers to rounding of
sums."""
COMPILERS = ("cc", "gcc", "clang")


def compile_c(folder: Path, words: Sequence[str], what: str) -> None:
    """Call this machine's C compiler in a folder; ExportError where there is none, or with the first error that it has
    with ``what``."""
    compiler = next(filter(shutil.which, COMPILERS), None)
    if compiler is None:
        raise ExportError("there is no C compiler on this machine; apt-get install gcc brings one on Debian")
    # where what a compiler leaves that is killed goes with the folder
    scratch = {**os.environ, "TMPDIR": str(folder.resolve())}
    done = subprocess.run([compiler, *words], cwd=folder, env=scratch, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        first = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
        raise ExportError(f"{compiler} does not build {what}: {first}")


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write text files into a folder that is there, some into folders in it."""
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def write_folder(target: Path, files: Mapping[str, str]) -> None:
    """Write text files into a new or empty folder, all of them or none.

    ExportError where the target is a file or a folder with something in it, or cannot be written.
    """
    target = target.resolve()
    if target.exists() and not target.is_dir():
        raise ExportError(f"{target}: is a file; name a new folder")
    if not target.parent.is_dir():
        raise ExportError(f"{target}: the folder {target.parent} does not exist")
    try:
        if target.exists() and (first := min(target.iterdir(), default=None)):
            raise ExportError(f"{target}: the folder holds {first.name} already; name a new or an empty folder")
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as beside:
            whole = Path(beside) / "whole"  # the temporary folder is private, this is an ordinary new one
            whole.mkdir()
            write_files(whole, files)
            whole.rename(target)  # an empty folder gives way, one that was filled meanwhile does not
    except OSError as error:
        raise ExportError(f"{target}: cannot be written ({error.strerror or error})") from None
