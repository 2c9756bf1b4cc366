"""Local files, and remote ones at URLs that fsspec knows.

A remote file is downloaded before it is read; files are written locally and whole, then uploaded.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from fsspec.core import url_to_fs
from fsspec.implementations.local import LocalFileSystem

from piezo_model.recordings import RecordingError


def filesystem(place: str) -> tuple[Any, str]:
    """The file system of a path or URL, and the path in it; RecordingError if fsspec knows none."""
    if "://" not in place:
        return LocalFileSystem(), os.path.abspath(place)
    try:
        return url_to_fs(place)
    except (ValueError, ImportError) as error:
        raise RecordingError(f"{place}: {' '.join(str(error).split())}") from None


def absolute(place: str) -> str:
    """The place, independent of the current folder."""
    return place if "://" in place else os.path.abspath(place)


def matching(places: Sequence[str]) -> list[str]:
    """Places, with patterns such as ``s3://bucket/*.parquet``, which no shell expands, replaced by their matches."""
    found: list[str] = []
    for place in places:
        fs, path = filesystem(place)
        if "*" not in place or fs.exists(path):
            found.append(place)
        elif matches := sorted(fs.glob(path)):
            found += [fs.unstrip_protocol(match) if "://" in place else match for match in matches]
        else:
            raise RecordingError(f"{place}: no file matches")
    return found


def names_of(places: Sequence[str]) -> list[str]:
    """Unique names for the products of files: their own without suffix, after as many parent folders as needed.

    Examples
    --------
    >>> names_of(["a/left.csv", "a/right.csv"]), names_of(["1/stage.csv", "2/stage.csv"])
    (['left', 'right'], ['1--stage', '2--stage'])
    """
    parts = [PurePosixPath(filesystem(place)[1]).with_suffix("").parts[1:] for place in places]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["--".join(path[-depth:]) for path in parts]
        if len(set(names)) == len(names):
            return names
    twice = next(i for i, path in enumerate(parts) if path in parts[:i])
    raise RecordingError(
        f"{places[twice]}: what is made of it would have the name of what is made of "
        f"{places[parts.index(parts[twice])]}"
    )


def model_of(place: str, name: str) -> str:
    """Place of the model: the file itself, or the one of this name in a folder."""
    fs, path = filesystem(place)
    return f"{absolute(place)}/{name}.json" if fs.isdir(path) else absolute(place)


@contextmanager
def file_here(place: str) -> Iterator[Path]:
    """A local file of the same name and content."""
    fs, path = filesystem(place)
    if isinstance(fs, LocalFileSystem):
        yield Path(path)
        return
    with TemporaryDirectory() as folder:
        here = Path(folder) / PurePosixPath(path).name
        fs.get_file(path, str(here))
        yield here


@contextmanager
def folder_here(place: str) -> Iterator[Path]:
    """A local folder for output: the place itself, or a temporary one that is uploaded at the end."""
    fs, path = filesystem(place)
    if isinstance(fs, LocalFileSystem):
        Path(path).mkdir(parents=True, exist_ok=True)
        yield Path(path)
        return
    with TemporaryDirectory() as folder:
        yield Path(folder)
        fs.makedirs(path, exist_ok=True)
        fs.put(f"{folder}/", path, recursive=True)
