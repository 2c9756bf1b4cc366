"""PI's General Command Set array, as PIMikroMove and ``qDRR`` write it: a header of ``# KEY = value``, then rows.

``SEPARATOR`` is the code of a character, ``SAMPLE_TIME`` is in seconds, ``NAMEn`` says what was recorded, for instance
"Target Position of axis 1" (PI manual SM146, section on GCS arrays).
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from piezo_model.recordings.dialect import Dialect
from piezo_model.recordings.formats.text import TextTable
from piezo_model.recordings.pieces import RecordingError
from piezo_model.recordings.tables import HEAD_BYTES, Column, Reading
from piezo_model.recordings.text_rows import TextRows

NAME = "a GCS array"
ORDER = 20
ENTRY = re.compile(r"#\s*([A-Z_]+\d*)\s*=\s*(.*?)\s*$", re.MULTILINE)


def recognises(path: Path, head: bytes) -> bool:
    """Whether the comments at the start are those of a GCS array."""
    return head.lstrip().startswith(b"#") and b"END_HEADER" in head and b"SEPARATOR" in head


def open_table(path: Path, reading: Reading) -> TextTable:
    """Read the header."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES).decode("latin-1")
    ends = re.search(r"END_HEADER[^\r\n]*(?:\r\n|\r|\n)", head)
    if ends is None:
        raise RecordingError(f"{path}: is a GCS array whose header does not end")
    header = dict(ENTRY.findall(head[: ends.end()]))
    rows = head[ends.end() :].strip().splitlines()
    if not rows:
        raise RecordingError(f"{path}: is a GCS array of zero rows")
    try:
        separator = chr(int(header["SEPARATOR"]))
        width = int(header.get("DIM", len(rows[0].split(separator))))
        sample_time = float(header["SAMPLE_TIME"]) if "SAMPLE_TIME" in header else None
    except (KeyError, ValueError) as error:
        raise RecordingError(f"{path}: is a GCS array with a damaged header: {error}") from None
    text = TextRows(
        path,
        "latin-1",
        Dialect(" " if separator in " \t" else separator, "."),
        width,
        ends.end(),
        path.stat().st_size,
        head[: ends.end()].count("\n"),
    )
    columns = tuple(
        Column.named(header.get(f"NAME{k}", f"column {k + 1}"), header.get(f"UNIT{k}", ""), sample_time=sample_time)
        for k in range(width)
    )
    return TextTable(path, tuple(_apart(columns)), "GCS array", text)


def _apart(columns: tuple[Column, ...]) -> list[Column]:
    """Two axes may record the same thing under one name."""
    names = [column.name for column in columns]
    return [
        replace(column, name=f"{column.name} ({k + 1})") if names.count(column.name) > 1 else column
        for k, column in enumerate(columns)
    ]
