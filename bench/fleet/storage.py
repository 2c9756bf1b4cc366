"""Files on this machine, or in a bucket or on a server by a URL that fsspec knows.

What is read is a local file, fetched where it is not one; what is written is written locally and whole, then uploaded.
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
    """The file system of a path or URL, and the path in it; RecordingError where fsspec knows none."""
    if "://" not in place:
        return LocalFileSystem(), os.path.abspath(place)
    try:
        return url_to_fs(place)
    except (ValueError, ImportError) as error:
        raise RecordingError(f"{place}: {' '.join(str(error).split())}") from None


def absolute(place: str) -> str:
    """The place as it is called from every folder."""
    return place if "://" in place else os.path.abspath(place)


def matching(places: Sequence[str]) -> list[str]:
    """The places with patterns such as ``s3://bucket/*.parquet``, which no shell expands, replaced by what is there."""
    found: list[str] = []
    for place in places:
        fs, path = filesystem(place)
        if "*" not in place or fs.exists(path):
            found.append(place)
        elif there := sorted(fs.glob(path)):
            found += [fs.unstrip_protocol(each) if "://" in place else each for each in there]
        else:
            raise RecordingError(f"{place}: no file matches")
    return found


def names_of(places: Sequence[str]) -> list[str]:
    """Names for what is made of files: their own without suffix, with as many folders before it as tell all apart.

    Examples
    --------
    >>> names_of(["a/left.csv", "a/right.csv"]), names_of(["1/stage.csv", "2/stage.csv"])
    (['left', 'right'], ['1--stage', '2--stage'])
    """
    parts = [PurePosixPath(filesystem(place)[1]).with_suffix("").parts[1:] for place in places]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["--".join(each[-depth:]) for each in parts]
        if len(set(names)) == len(names):
            return names
    twice = next(i for i, each in enumerate(parts) if each in parts[:i])
    raise RecordingError(
        f"{places[twice]}: what is made of it would have the name of what is made of "
        f"{places[parts.index(parts[twice])]}"
    )


def model_of(place: str, name: str) -> str:
    """The model at a place, or in the folder there the one of a name."""
    fs, path = filesystem(place)
    return f"{absolute(place)}/{name}.json" if fs.isdir(path) else absolute(place)


@contextmanager
def file_here(place: str) -> Iterator[Path]:
    """The file at a place as a local one, of the same name."""
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
    """A local folder to write whole files into: that at the place, or one whose files are uploaded at the end."""
    fs, path = filesystem(place)
    if isinstance(fs, LocalFileSystem):
        Path(path).mkdir(parents=True, exist_ok=True)
        yield Path(path)
        return
    with TemporaryDirectory() as folder:
        yield Path(folder)
        fs.makedirs(path, exist_ok=True)
        fs.put(f"{folder}/", path, recursive=True)
