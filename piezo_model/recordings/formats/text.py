"""Plain text of every kind: `dialect` detects from the first lines how it is written, then Arrow parses it
(`text_table`)."""

import codecs
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.dialect import Layout, layout_of
from piezo_model.recordings.sampling_remark import sample_time_in
from piezo_model.recordings.tables import HEAD_BYTES, ReadOptions
from piezo_model.recordings.text_table import LINE, LONGEST_LINE, TextTable, end_of_rows

NAME = "plain text"
READS = ("header_row", "decimal")
SAMPLE_LINES = 1000
SEPARATOR_NAMES = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", " ": "blanks"}
BYTE_ORDER_MARKS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
ENCODING_NAMES = {"utf-8": "", "latin-1": " in Latin-1", "utf-16-le": " in UTF-16", "utf-16-be": " in UTF-16"}


def open_table(path: Path, options: ReadOptions) -> TextTable:
    """Find encoding, dialect, header and the first and last row."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        complete = not file.read(1)
    encoding, mark = _encoding(path, head)
    lines = LINE.findall(head[mark:].decode(encoding, errors="replace"))
    if not complete and len(lines) > 1:
        lines = lines[:-1]
    elif not complete and len(head) >= min(HEAD_BYTES, LONGEST_LINE):
        raise RecordingError(f"{path}: row 1 is longer than {HEAD_BYTES} bytes, which no row of a table is")
    header = None if options.header_row is None else options.header_row - 1
    layout = layout_of(lines[:SAMPLE_LINES], options.decimal, header) or layout_of(lines, options.decimal, header)
    if layout is None:
        raise RecordingError(f"{path}: {_no_table(lines)}")
    _refuse_ambiguous_commas(path, lines, layout)
    start = mark + sum(len(line.encode(encoding, errors="replace")) for line in lines[: layout.start])
    start += len(lines[layout.start][: layout.glued].encode(encoding))
    stop, dropped = end_of_rows(path, encoding, layout, start)
    stated = sample_time_in(lines[: layout.start] if layout.header is None else lines[: layout.header])
    columns = tuple(replace(column, sample_time=stated) for column in layout.columns)
    return TextTable(path, _form(encoding, layout, dropped), columns, encoding, layout, start, stop)


def _encoding(path: Path, head: bytes) -> tuple[str, int]:
    """Encoding, and length of the byte order mark."""
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if head.startswith(mark):
            return encoding, len(mark)
    sample = head[:4096]
    if b"\0" in head:
        for odd, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
            if sample[odd::2].count(0) > 0.9 * len(sample[odd::2]) and not sample[1 - odd :: 2].count(0):
                return encoding, 0
        raise RecordingError(f"{path}: is neither plain text nor in a known format")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # the last character may be cut in two
    except UnicodeDecodeError:
        return "latin-1", 0
    return "utf-8", 0


def _no_table(lines: Sequence[str]) -> str:
    written = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not written:
        return "holds no table, only blank or comment lines"
    if len(written) == 1:
        return "has a header and no data rows"
    return "holds no rows of numbers in its first lines; --header-row says which row names the columns"


def _refuse_ambiguous_commas(path: Path, lines: Sequence[str], layout: Layout) -> None:
    """Refuse a table whose commas seem to be both separators and decimal marks."""
    if layout.header is not None or layout.dialect.separator != "," or not layout.start:
        return
    header, cells = layout.dialect.split(lines[layout.start - 1]), layout.dialect.split(lines[layout.start])
    if 1 < len(header) < len(cells) <= 2 * len(header) and all(re.fullmatch(r"[+-]?\d+", cell) for cell in cells):
        raise RecordingError(
            f"{path}: row {layout.start + 1} (data row 1) has {len(cells)} columns where the header has "
            f"{len(header)}; its numbers seem to have decimal commas, write decimal points"
        )


def _form(encoding: str, layout: Layout, dropped: int) -> str:
    incomplete = "line is incomplete and was" if dropped == 1 else f"{dropped} lines are incomplete and were"
    clauses = {
        f"text{ENCODING_NAMES[encoding]}": True,
        f"separated by {SEPARATOR_NAMES[layout.dialect.separator]}": True,
        "decimal comma": layout.dialect.decimal == ",",
        "no header" if layout.header is None else f"header in row {layout.header + 1}": True,
        "which holds the first row, too": layout.glued,
        f"the last {incomplete} left out": dropped,
    }
    return ", ".join(clause for clause, holds in clauses.items() if holds)
