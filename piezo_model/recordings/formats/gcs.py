"""PI's General Command Set array, as PIMikroMove and ``qDRR`` write it: a header of ``# KEY = value``, then rows.

``SAMPLE_TIME`` is in seconds, and ``NAMEn`` names a recorded signal, for instance
"Target Position of axis 1" (PI manual SM146, section on GCS arrays).
"""

import re
from dataclasses import replace
from pathlib import Path

from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.formats import text
from piezo_model.recordings.tables import HEAD_BYTES, Column, ReadOptions, distinct
from piezo_model.recordings.text_table import TextTable

NAME = "a GCS array"
ENTRY = re.compile(r"#\s*([A-Z_]+\d*)\s*=\s*(.*?)\s*$", re.MULTILINE)


def recognises(path: Path, head: bytes) -> bool:
    """Whether the comments at the start are those of a GCS array."""
    return head.lstrip().startswith(b"#") and b"END_HEADER" in head and b"SEPARATOR" in head


def open_table(path: Path, options: ReadOptions) -> TextTable:
    """Read the rows like any text with comments, and sampling period, names and units from the header."""
    with path.open("rb") as file:
        header = dict(ENTRY.findall(file.read(HEAD_BYTES).decode("latin-1")))
    table = text.open_table(path, options)
    try:
        period = float(header["SAMPLE_TIME"]) if "SAMPLE_TIME" in header else None
    except ValueError:
        raise RecordingError(f"{path}: SAMPLE_TIME in the header is not a number: {header['SAMPLE_TIME']}") from None
    names = [header.get(f"NAME{k}", column.name) for k, column in enumerate(table.columns)]
    columns = (
        Column.named(
            name,
            header.get(f"UNIT{k}", ""),
            sample_time=table.columns[k].sample_time if period is None else period,
        )
        for k, name in enumerate(distinct(names))  # two axes may have the same name
    )
    return replace(table, columns=tuple(columns), form="GCS array")
