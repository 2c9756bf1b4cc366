"""A folder that is there whole or not at all: written beside the target, then renamed to it."""

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from bench.export.settings import ExportError


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
