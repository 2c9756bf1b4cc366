"""The formats, recognised by their first bytes and never by their suffix alone. A format is one function and one line:

    read(path) -> Arrays              named arrays, units, sampling periods (`array_table`), or tables
    Format(name, recognises, read)    in FORMATS

If its library reads all values at once, a reader first passes the size that the file states to `table.check_size`.
"""

import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from piezo_model.recordings.array_table import Arrays, table_of
from piezo_model.recordings.formats.arrow import open_parquet, open_stream
from piezo_model.recordings.formats.libraries import read_hdf5, read_matlab, read_npy, read_npz, read_tdms
from piezo_model.recordings.formats.text import BYTE_ORDER_MARKS, HEAD_BYTES, open_text
from piezo_model.recordings.formats.xlsx import open_workbook
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.table import RecordingError, Table, reading


def begins(*marks: bytes) -> Callable[[Path, bytes], bool]:
    """A test of whether a file begins with one of some marks."""
    return lambda path, head: head.startswith(marks)


def members(path: Path, head: bytes) -> list[str]:
    """Names in an archive; none of another file."""
    if not (head.startswith(b"PK\x03\x04") and zipfile.is_zipfile(path)):
        return []
    with zipfile.ZipFile(path) as archive:
        return archive.namelist()


class Format(NamedTuple):
    """A file format."""

    name: str
    """With its article, for sentences."""
    recognises: Callable[[Path, bytes], bool]
    """Of the path and the first bytes."""
    read: Callable[..., Any]
    """Of the path, and the values of the options that it takes."""
    takes: tuple[str, ...] = ()
    """Options that apply only to some formats, including this one."""


def refuse_json(path: Path, *options: object) -> NoReturn:
    """Refuse what plain text would take for a table: a model has numbers in lines, too."""
    raise RecordingError(f"{path}: is JSON, as models are, and no table of rows; save a recording as CSV or Parquet")


FORMATS = (
    Format("a Parquet file", begins(b"PAR1"), open_parquet),
    Format(
        "a stream of Arrow batches",
        lambda path, head: head.startswith(b"\xff\xff\xff\xff") and path.suffix in (".arrow", ".arrows"),
        open_stream,
    ),
    Format("a NumPy file", begins(b"\x93NUMPY"), read_npy),
    Format(
        "an archive of NumPy",
        lambda path, head: any(name.endswith(".npy") for name in members(path, head)),
        read_npz,
    ),
    Format(
        "an Excel workbook",
        lambda path, head: "xl/workbook.xml" in members(path, head),
        open_workbook,
        takes=("header_row", "table"),
    ),
    Format(
        "an HDF5 file",
        lambda path, head: any(head[at : at + 8] == b"\x89HDF\r\n\x1a\n" for at in (0, 512, 1024, 2048, 4096)),
        read_hdf5,
    ),
    Format("a MATLAB file", begins(b"MATLAB "), read_matlab),
    Format("a TDMS file", begins(b"TDSm"), read_tdms),
    Format(
        "JSON",
        lambda path, head: head.lstrip()[:1] in (b"{", b"[") and path.read_bytes().rstrip()[-1:] in (b"}", b"]"),
        refuse_json,
        takes=("header_row", "decimal", "table"),
    ),
    Format(
        "plain text",
        lambda path, head: b"\0" not in head or head.startswith(tuple(BYTE_ORDER_MARKS)),
        open_text,
        takes=("header_row", "decimal", "table"),
    ),
)
"""In the order in which they are tried."""


def open_tables(path: str | Path, options: ReadOptions) -> list[Table]:
    """Open the tables of a file of any known format.

    Raises
    ------
    RecordingError
        The file is missing, empty, a folder, of an unknown format, damaged, or needs a package that is not installed.
    """
    path = Path(path)
    with reading(path, "an archive"):
        if path.exists() and not path.is_file():  # a pipe would be waited for, and a device has no end
            raise RecordingError(f"{path}: is a folder, a pipe or a device, not a file")
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if not head:
            raise RecordingError(f"{path}: is an empty file")
        format = next((candidate for candidate in FORMATS if candidate.recognises(path, head)), None)
    if format is None:
        raise RecordingError(f"{path}: is none of these: {', '.join(known.name for known in FORMATS)}")
    for name in ("header_row", "decimal", "table"):
        if getattr(options, name) is not None and name not in format.takes:
            raise RecordingError(f"{path}: is {format.name}, which takes no {name.replace('_', ' ')}")
    with reading(path, format.name), warnings.catch_warnings(action="ignore"):  # from libraries
        contents = format.read(path, *(getattr(options, name) for name in format.takes if name != "table"))
        return [table_of(path, contents)] if isinstance(contents, Arrays) else contents
