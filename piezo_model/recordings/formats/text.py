"""Plain text of every kind: its layout follows from the first lines (`layout`), then Arrow parses it (`text_rows`)."""

import codecs
from collections.abc import Sequence
from pathlib import Path

from piezo_model.recordings.clock_cells import times
from piezo_model.recordings.layout import LINE, SEPARATORS, Layout, Region, layout_of, regions_of
from piezo_model.recordings.table import RecordingError, Table
from piezo_model.recordings.text_rows import Source, TextRows, blocks_of, end_of_rows

HEAD_BYTES = 1 << 18
"""Bytes at the start of a file that determine its format; the header of a text must lie within them."""
SAMPLE_LINES = 1000
BYTE_ORDER_MARKS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
ENCODINGS = {"utf-8": "", "latin-1": " in Latin-1", "utf-16-le": " in UTF-16", "utf-16-be": " in UTF-16"}
"""Encodings, and how a description names them."""


def open_text(path: Path, header_row: int | None, decimal: str | None) -> list[Table]:
    """The tables of a file."""
    return tables_of(Source(path, lambda: path.open("rb"), path.stat().st_size), header_row, decimal)


def tables_of(source: Source, header_row: int | None, decimal: str | None) -> list[Table]:
    """Find encoding and dialect, and of each table the header and the first and last row; none in an empty sheet.

    Raises
    ------
    RecordingError
        A file that is not text, or has no rows of numbers.
    """
    path, stop = source.path, source.size
    with source.open() as file:
        encoding, mark = _encoding(path, file.read(HEAD_BYTES))
    lines = _first_lines(source, encoding, mark, stop)
    layout = layout_of(lines[:SAMPLE_LINES], decimal, header_row) or layout_of(lines, decimal, header_row)
    if source.sheet and (layout is None or layout.dialect.separator != "\t"):
        return []
    if layout is None:
        raise RecordingError(
            f"{path}: holds no data rows, or none in its first lines; --header-row says which row names the columns"
        )
    regions = regions_of(blocks_of(source, encoding, mark, stop), layout.dialect, lambda text: _size(text, encoding))
    if header_row is not None:  # the user's table ends where the next one begins
        regions = [Region(), *(region for region in regions if header_row and region.line + region.names >= header_row)]
    tables = []
    for region, end in zip(regions, [*(mark + region.begin for region in regions[1:]), stop], strict=True):
        if layout is None or len(regions) > 1 or region.names > layout.start:
            lines = _first_lines(source, encoding, mark + region.begin, end)
            layout = layout_of(lines[: region.names + SAMPLE_LINES], decimal, header_row, region.names)
        if layout is not None:
            tables.append(_table(source, encoding, lines, layout, region, mark + region.begin, end))
        if header_row is not None:
            break
    return tables


def _table(
    source: Source, encoding: str, lines: Sequence[str], layout: Layout, region: Region, begin: int, end: int
) -> Table:
    start = begin + sum(_size(line, encoding) for line in lines[: layout.start])
    start += _size(lines[layout.start][: layout.glued], encoding)
    stop, dropped = end_of_rows(source, encoding, layout, start, end)
    header = region.line + (layout.header or 0) + 1
    clauses = {
        f"{source.form}{ENCODINGS[encoding]}": True,
        f"separated by {SEPARATORS[layout.dialect.separator]}": not source.sheet,
        "decimal comma": layout.dialect.decimal == ",",
        "no header" if layout.header is None else f"header in row {header}": True,
        "which also contains the first row": layout.glued,
    }
    form = ", ".join(clause for clause, holds in clauses.items() if holds)
    rows = TextRows(source, encoding, layout, start, stop, region.line)
    repairs = (f"incomplete lines at the end are left out: {dropped}",) * (dropped > 0)
    return Table(
        source.path,
        form,
        layout.columns,
        rows.batches,
        rows.where,
        repairs,
        times,
        ": ".join(filter(None, (source.sheet, region.title))),
        region.rows,
    )


def _size(text: str, encoding: str) -> int:
    return len(text.encode(encoding, errors="replace"))


def _first_lines(source: Source, encoding: str, begin: int, end: int) -> list[str]:
    """The first complete lines between two bytes of a file."""
    blocks = list(blocks_of(source, encoding, begin, min(end, begin + HEAD_BYTES)))
    lines = LINE.findall("".join(blocks if end <= begin + HEAD_BYTES else blocks[:-1]))
    if not lines and end > begin + HEAD_BYTES:
        raise RecordingError(f"{source.path}: row 1 is longer than {HEAD_BYTES} bytes, which no row of a table is")
    return lines


def _encoding(path: Path, head: bytes) -> tuple[str, int]:
    """Encoding, and length of the byte order mark."""
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if head.startswith(mark):
            return encoding, len(mark)
    if b"\0" in head:
        raise RecordingError(
            f"{path}: is neither plain text nor in a format that is read: Parquet, Arrow, NumPy, HDF5, MATLAB, Excel "
            "or TDMS"
        )
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # the last character may be cut in two
    except UnicodeDecodeError:
        return "latin-1", 0
    return "utf-8", 0
