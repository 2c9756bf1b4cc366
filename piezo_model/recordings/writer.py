"""Writes columns of numbers to a CSV or Parquet file, completely or not at all.

The columns are checked before the first byte is written. The table is written next to its target and renamed over it
(:mod:`piezo_model.atomic_file`): a reader sees the old file or the new one, and a failure leaves the old one unchanged.
CSV follows RFC 4180, with the shortest decimals that give the same float64 back.
"""

import csv
import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.atomic_file import replacing
from piezo_model.recordings.table import RecordingError

WRITTEN_SUFFIXES = (".csv", ".parquet")


def write_table(path: str | Path, columns: Mapping[str, ArrayLike], remark: str = "") -> None:
    """Write named columns of equal length atomically; numbers are read back to the last bit.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (comma, decimal point, header) or ``.parquet``; an existing file is replaced.
    columns : mapping of str to array, shape (rows,)
        Finite numbers; put units in the names (``time_s``, ``voltage_V``).
    remark : str
        A comment above the header of CSV, ``remark`` in Parquet's metadata.

    Raises
    ------
    RecordingError
        Unknown suffix, unequal lengths, values that are not finite numbers, or a folder that cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "drive.csv"
    >>> write_table(path, {"time_s": [0.0, 0.005], "voltage_V": [1.8, 1.9]})
    >>> print(path.read_text(), end="")
    time_s,voltage_V
    0,1.8
    0.005,1.9
    """
    path = Path(path)
    if path.suffix.lower() not in WRITTEN_SUFFIXES:
        raise RecordingError(
            f"{path}: unknown suffix {path.suffix!r}; a table is written as {' or '.join(WRITTEN_SUFFIXES)}"
        )
    import pyarrow.parquet  # only here, since a program without files need not load it

    checks.check(columns, f"{path}: a table needs at least one column", RecordingError)
    with checks.refusing(RecordingError, f"{path}: "):
        arrays = checks.vectors(**columns)
        checks.finite_arrays(**dict(zip(columns, arrays, strict=True)))
    table = pyarrow.table(arrays, [*columns])
    if remark:
        table = table.replace_schema_metadata({"remark": remark})
    write = _write_csv if path.suffix.lower() == ".csv" else pyarrow.parquet.write_table
    try:
        with replacing(os.path.realpath(path)) as temporary, temporary.open("wb") as file:  # a link stays a link
            write(table, file)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from None


def _write_csv(table: Any, file: BinaryIO) -> None:
    from pyarrow.csv import WriteOptions, write_csv

    header = io.StringIO()
    header.writelines(f"# {' '.join(remark.decode().split())}\n" for remark in (table.schema.metadata or {}).values())
    csv.writer(header, lineterminator="\n").writerow(table.column_names)
    file.write(header.getvalue().encode())
    write_csv(table, file, WriteOptions(include_header=False))
