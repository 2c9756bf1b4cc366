"""Compile exported source on this machine, and write it to a folder, whole or not at all."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.export.settings import ExportError
from piezo_model.atomic_file import write_text

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
EXACT = ("-ffp-contract=off",)
"""No fused multiply-add, so that every compiler and machine gives the same bits."""
COMPILERS = ("cc", "gcc", "clang")


def compile_c(folder: Path, words: Sequence[str], what: str) -> None:
    """Run the C compiler in a folder; ExportError without a compiler, or with its first error on ``what``."""
    compiler = next(filter(shutil.which, COMPILERS), None)
    if compiler is None:
        raise ExportError("there is no C compiler on this machine; on Debian, apt-get install gcc")
    scratch = {**os.environ, "TMPDIR": str(folder.resolve())}  # a killed compiler leaves its files in the folder
    done = subprocess.run([compiler, *words], cwd=folder, env=scratch, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        first = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
        raise ExportError(f"{compiler} cannot build {what}: {first}")


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write text files into an existing folder and its subfolders."""
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        write_text(folder / name, text)


def write_folder(target: Path, files: Mapping[str, str]) -> None:
    """Write text files into a new or empty folder, all of them or none.

    ExportError if the target has content, or cannot be written.
    """
    target = target.resolve()
    try:
        if target.exists() and (first := min(target.iterdir(), default=None)):
            raise ExportError(f"{target}: the folder holds {first.name} already; name a new or an empty folder")
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as beside:
            whole = Path(beside) / "whole"  # with ordinary permissions, unlike the temporary folder
            whole.mkdir()
            write_files(whole, files)
            whole.rename(target)  # replaces an empty folder, fails if it has been filled meanwhile
    except OSError as error:
        raise ExportError(f"{target}: cannot be written ({error.strerror or error})") from None
