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


def open_table(path: str | Path, reading: ReadOptions | None = None) -> Table:
    """Open a table of any known format.

    Raises
    ------
    RecordingError
        The file is missing, empty, a folder, of an unknown format, damaged, or needs a package that is not installed.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise RecordingError(f"{path}: is a folder, not a file")
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if not head:
            raise RecordingError(f"{path}: is an empty file")
        formats = _registered()
        text = formats["text"]  # is what no other format recognises
        known = next((each for each in formats.values() if each is not text and each.recognises(path, head)), text)
        reading = reading or ReadOptions()
        for name in ("header_row", "decimal", "sheet"):
            if getattr(reading, name) is not None and name not in getattr(known, "READS", ()):
                raise RecordingError(f"{path}: is {known.NAME}, for which no {name.replace('_', ' ')} can be given")
        if getattr(known, "APART", False):
            if sys.platform != "linux":
                raise RecordingError(
                    f"{path}: is {known.NAME}, which is read in a process of its own, Linux only; text and Parquet are "
                    "read everywhere"
                )
            from piezo_model.recordings import subprocess_reader

            return subprocess_reader.open_table(known, path, reading)
        return known.open_table(path, reading)
    except ModuleNotFoundError as error:
        if error.name == "pyarrow":  # on which the registry of formats stands
            raise RecordingError(
                f"{path}: reading a file needs the package pyarrow: install piezobench[bench]"
            ) from None
        raise RecordingError(
            f"{path}: is {known.NAME}, and reading it needs the package {error.name}: install piezobench[formats]"
        ) from None
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such file") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or first_line(error)}") from None


@cache
def _registered() -> dict[str, ModuleType]:
    """Every format by its module's name."""
    formats = importlib.import_module("piezo_model.recordings.formats")
    names = [module.name for module in pkgutil.iter_modules(formats.__path__)]
    return {name: importlib.import_module(f"{formats.__name__}.{name}") for name in names}
