"""Opens a file of any known format; a format is a file in :mod:`piezo_model.recordings.formats`, and that folder is the
registry."""

import importlib
import pkgutil
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

from piezo_model.recordings.chunks import RecordingError, first_line
from piezo_model.recordings.tables import HEAD_BYTES, ReadOptions, Table

MOST_COLUMNS = 10_000


def open_table(path: str | Path, options: ReadOptions | None = None) -> Table:
    """Open a table of any known format.

    Raises
    ------
    RecordingError
        The file is missing, empty, a folder, of an unknown format, damaged, or needs a package that is not installed.
    """
    path, options = Path(path), options or ReadOptions()
    try:
        if path.is_dir():
            raise RecordingError(f"{path}: is a folder, not a file")
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if not head:
            raise RecordingError(f"{path}: is an empty file")
        text, *binary = _formats()
        format = next((each for each in binary if each.recognises(path, head)), text)
        for name in ("header_row", "decimal", "sheet"):
            if getattr(options, name) is not None and name not in getattr(format, "READS", ()):
                raise RecordingError(f"{path}: is {format.NAME}, for which no {name.replace('_', ' ')} can be given")
        if getattr(format, "SUBPROCESS", False):
            if sys.platform != "linux":
                raise RecordingError(
                    f"{path}: is {format.NAME}, which is read in a process of its own, Linux only; text and Parquet "
                    "are read everywhere"
                )
            from piezo_model.recordings import subprocess_reader

            table = subprocess_reader.open_table(format, path, options)
        else:
            table = format.open_table(path, options)
        if len(table.columns) > MOST_COLUMNS:
            raise RecordingError(
                f"{path}: has {len(table.columns)} columns, and no recording has more than {MOST_COLUMNS}"
            )
        return table
    except ModuleNotFoundError as error:
        if error.name == "pyarrow":  # which the formats import at once
            raise RecordingError(
                f"{path}: reading a file needs the package pyarrow: install piezobench[bench]"
            ) from None
        raise RecordingError(
            f"{path}: is {format.NAME}, and reading it needs the package {error.name}: install piezobench[formats]"
        ) from None
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such file") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or first_line(error)}") from None


@cache
def _formats() -> list[ModuleType]:
    """The modules of all formats; first that of plain text, which any other file is taken for."""
    package = importlib.import_module("piezo_model.recordings.formats")
    names = sorted((module.name for module in pkgutil.iter_modules(package.__path__)), key=lambda name: name != "text")
    return [importlib.import_module(f"{package.__name__}.{name}") for name in names]
