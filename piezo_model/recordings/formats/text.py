"""Plain text of every kind: its layout follows from the first lines (`layout`), then Arrow parses its rows, which are
whole lines in UTF-8 with one separator.

Text that Arrow cannot parse is removed block by block: comments and repeated headers among the rows, runs of blanks, a
remark or half a row at the end. If Arrow refuses a block, a second, slower pass finds the first wrong cell and its row
as an editor counts it."""

import codecs
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice, takewhile
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv

from piezo_model.recordings.clock_cells import times
from piezo_model.recordings.formats.arrow import array_of
from piezo_model.recordings.layout import (
    COMMENT_MARKS,
    LINE,
    NULLS,
    RUNS,
    SEPARATORS,
    VALUES,
    Layout,
    Region,
    as_remark,
    cells_of,
    layout_of,
    regions_of,
)
from piezo_model.recordings.table import RecordingError, Table, first_line
from solvers.arrays import Vector

HEAD_BYTES = LONGEST_LINE = 1 << 18
"""Bytes at the start of a file that determine its format; the header of a text is within them, and no row is longer."""
SAMPLE_LINES = 1000
BYTE_ORDER_MARKS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
ENCODINGS = {"utf-8": "", "latin-1": " in Latin-1", "utf-16-le": " in UTF-16", "utf-16-be": " in UTF-16"}
"""Encodings, and how a description names them."""
BLOCK_BYTES = 1 << 20
LARGEST_BLOCK = 1 << 24
"""Bytes of a block with the rest of the previous one, in UTF-8."""
GROUPED = re.compile(r"[+-]?(?:\d{1,3}|[1-9]\d{0,2}(?:[.,]\d{3})+)")
"""Whole numbers with marks between thousands."""
TAIL_BYTES, MOST_TRUNCATED = 1 << 16, 2
MARGINS = re.compile(r"^[ \t]+|(?<![ \t])[ \t]++(?=\r?$)", re.MULTILINE)


class Source(NamedTuple):
    """A text in a file or a sheet."""

    path: Path
    open: Callable[[], BinaryIO]
    size: int
    """Bytes."""
    sheet: str = ""
    """Title of a sheet; "" for a file of text."""


@dataclass(frozen=True)
class TextRows:
    """Where the rows of a text are, and how they are written."""

    source: Source
    encoding: str
    layout: Layout
    start: int
    """Byte of the first row."""
    stop: int
    """Byte after the last row."""
    line: int = 0
    """Lines of the file above those that the layout counts."""

    def batches(self, at: Sequence[int]) -> Iterator[list[Any]]:
        """Columns in batches of rows, with clocks as text.

        Raises
        ------
        RecordingError
            A row or a cell that cannot be read.
        """
        layout, dialect = self.layout, self.layout.dialect
        keys = [str(k) for k in range(len(layout.columns))]  # names in the file may repeat or be empty
        clocks = {k for k in at if layout.columns[k].kind == "clock"}
        delimiter = "\t" if dialect.separator in RUNS else dialect.separator
        options = (
            arrow_csv.ReadOptions(use_threads=False, column_names=keys, block_size=LARGEST_BLOCK),
            arrow_csv.ParseOptions(delimiter=delimiter, quote_char='"' if layout.quoted else False),
            arrow_csv.ConvertOptions(
                column_types={keys[k]: pa.string() if k in clocks else pa.float64() for k in at},
                include_columns=list(dict.fromkeys(keys[k] for k in at)),
                null_values=sorted(NULLS),
                strings_can_be_null=True,
                decimal_point=dialect.decimal,
                check_utf8=False,
            ),
        )
        for block in filter(
            bytes.strip, map(self._for_arrow, blocks_of(self.source, self.encoding, self.start, self.stop))
        ):
            try:
                table = arrow_csv.read_csv(pa.BufferReader(block), *options)
            except (pa.ArrowException, UnicodeError) as error:
                raise RecordingError(self._complaint([k for k in at if k not in clocks], error)) from None
            lines = (block.count(b"\n") or block.count(b"\r")) + (not block.endswith((b"\n", b"\r")))
            if layout.quoted and len(table) != lines:
                raise RecordingError(f"{self.source.path}: has an unclosed quote: {lines} lines give {len(table)} rows")
            cells = {k: table[keys[k]].combine_chunks() for k in at}
            columns = {k: column if k in clocks else array_of(column) for k, column in cells.items()}
            for k in columns.keys() - clocks:
                self._refuse_grouped(k, columns[k], block, delimiter)
            yield [columns[k] for k in at]

    def _refuse_grouped(self, k: int, values: Vector, block: bytes, delimiter: str) -> None:
        """Refuse whole numbers of which the large ones have marks between thousands, read as 999 next to 1.234."""
        known = values[np.isfinite(values)]
        if not (known[np.abs(known) >= 100.0] % 1.0 == 0.0).any() or (known != np.round(known, 3)).any():
            return
        cells = [cells_of(line.rstrip(), delimiter)[k].strip() for line in LINE.findall(block.decode())]
        if {3, 5}.issubset(map(len, cells)) and all(map(GROUPED.fullmatch, cells)):
            raise RecordingError(
                f"{self.source.path}: column {self.layout.columns[k].name!r} holds numbers such as "
                f"{max(cells, key=len)!r} and {min(cells, key=len)!r}; is the mark between thousands? Write them "
                "without it"
            )

    def where(self, row: int) -> str:
        """Name of a data row counted from 0: its row in the file as an editor counts, and its data row from 1."""
        return next((place for k, place, _ in self._named_rows(row) if k == row), f"data row {row + 1}")

    def _named_rows(self, first: int = 0) -> Iterator[tuple[int, str, str]]:
        """Number, name and text of each row; blocks with nothing but rows before the ``first`` one are skipped."""
        number, row = self.line + self.layout.start, 0
        of = f" of sheet {self.source.sheet!r}" if self.source.sheet else ""
        for block in blocks_of(self.source, self.encoding, self.start, self.stop):
            lines = block.count("\n") or block.count("\r")
            if row + lines <= first and self._is_plain(block):
                number, row = number + lines, row + lines
                continue
            for line in LINE.findall(block):
                number += 1
                if self._is_row(line):
                    yield row, f"row {number}{of} (data row {row + 1})", line
                    row += 1

    def _complaint(self, chosen: Sequence[int], error: Exception) -> str:
        """A message about the first row that cannot be read; Arrow's own if no row seems wrong."""
        dialect, columns = self.layout.dialect, self.layout.columns
        for _, place, line in self._named_rows():
            cells = dialect.split(line)
            if len(cells) != len(columns):
                return f"{self.source.path}: {place} has {len(cells)} columns where the others have {len(columns)}"
            for at in chosen:
                cell = cells[at].strip()
                if dialect.kind(cell) in ("number", "empty"):
                    continue
                shown = repr(cell if len(cell) <= 40 else cell[:37] + "…")
                needed = "a number is needed" + ", not a flag" * (dialect.kind(cell) == "flag")
                return f"{self.source.path}: column {columns[at].name!r} holds {shown} in {place}, where {needed}"
        return f"{self.source.path}: cannot be read as a table: {first_line(error)}"

    @cached_property
    def _marks(self) -> tuple[str, ...]:
        """The marks that start a comment, without the separator, which may also follow an empty first cell."""
        return tuple(mark for mark in COMMENT_MARKS if mark != self.layout.dialect.separator)

    def _is_plain(self, block: str) -> bool:
        """True if all lines of a block are rows."""
        blank = "\n\n" in block or "\n\r" in block or "\r\r" in block or block.isspace() or block[:1] in "\r\n"
        signs = *self._marks, *(max(remark.split("0"), key=len) for remark in self.layout.remarks)
        return not blank and not any(sign in block for sign in signs)

    def _is_row(self, line: str) -> bool:
        blank = line.isspace() if self.layout.dialect.separator == " " else not line.strip(" \r\n")
        return (
            not blank and not line.lstrip(" \t").startswith(self._marks) and as_remark(line) not in self.layout.remarks
        )

    def _for_arrow(self, block: str) -> bytes:
        """The rows of a block in the syntax of Arrow."""
        if not self._is_plain(block):
            block = "".join(filter(self._is_row, LINE.findall(block)))
        if run := RUNS.get(self.layout.dialect.separator):
            block = run.sub("\t", MARGINS.sub("", block))
        return block.encode()


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
        encoding, mark = _encoding(file.read(HEAD_BYTES))
    lines = _first_lines(source, encoding, mark, stop)
    layout = layout_of(lines[:SAMPLE_LINES], decimal, header_row) or layout_of(lines, decimal, header_row)
    tables: list[Table] = []
    if layout is not None and not (source.sheet and layout.dialect.separator != "\t"):
        blocks = blocks_of(source, encoding, mark, stop)
        regions = regions_of(blocks, layout.dialect, lambda text: _size(text, encoding))
        spans = [*zip(regions, [*(mark + region.begin for region in regions[1:]), stop], strict=True)]
        if header_row is not None:
            spans = [span for span in spans if span[0].line < max(header_row, 1)][-1:]
        for region, end in spans:
            if layout is None or len(regions) > 1 or region.names > layout.start:
                lines = _first_lines(source, encoding, mark + region.begin, end)
                named_by = header_row and header_row - region.line
                layout = layout_of(lines[: region.names + SAMPLE_LINES], decimal, named_by, region.names)
            if layout is not None:
                tables.append(_table(source, encoding, lines, layout, region, mark + region.begin, end))
    if not tables and not source.sheet:
        raise RecordingError(
            f"{path}: holds no data rows, or "
            + (f"no names in row {header_row}" if header_row else "none in its first lines")
            + "; --header-row says which row names the columns"
        )
    return tables


def _table(
    source: Source, encoding: str, lines: Sequence[str], layout: Layout, region: Region, begin: int, end: int
) -> Table:
    above = [*lines[: layout.start], lines[layout.start][: layout.glued]]
    start = begin + sum(_size(line, encoding) for line in above)
    stop, dropped = end_of_rows(source, encoding, layout, start, end)
    clauses = {
        f"Excel, sheet {source.sheet!r}" if source.sheet else f"text{ENCODINGS[encoding]}": True,
        f"separated by {SEPARATORS[layout.dialect.separator]}": not source.sheet,
        "decimal comma": layout.dialect.decimal == ",",
        "no header" if layout.header is None else f"header in row {region.line + layout.header + 1}": True,
        "which also contains the first row": layout.glued,
    }
    form = ", ".join(clause for clause, holds in clauses.items() if holds)
    rows = TextRows(source, encoding, layout, start, stop, region.line)
    return Table(
        source.path,
        form,
        layout.columns,
        rows.batches,
        rows.where,
        (f"incomplete lines at the end are left out: {dropped}",) * (dropped > 0),
        times,
        ": ".join(filter(None, (source.sheet, region.title))),
        region.rows,
    )


def _size(text: str, encoding: str) -> int:
    return len(text.encode(encoding, errors="replace"))


def _first_lines(source: Source, encoding: str, begin: int, end: int) -> list[str]:
    """The first lines between two bytes of a file."""
    return LINE.findall("".join(islice(blocks_of(source, encoding, begin, end), 2))[:HEAD_BYTES])


def _encoding(head: bytes) -> tuple[str, int]:
    """Encoding, and length of the byte order mark."""
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if head.startswith(mark):
            return encoding, len(mark)
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # the last character may be cut in two
    except UnicodeDecodeError:
        return "latin-1", 0
    return "utf-8", 0


def blocks_of(source: Source, encoding: str, start: int, stop: int) -> Iterator[str]:
    """The text between two byte positions, in blocks of whole lines."""
    decoder = codecs.getincrementaldecoder(encoding)(errors="replace")
    rest = ""
    with source.open() as file:
        file.seek(start)
        while data := file.read(min(BLOCK_BYTES, stop - file.tell())):
            text = rest + decoder.decode(data)
            cut = text.rfind("\n") + 1 or text.rfind("\r") + 1
            if not cut and len(text) > LONGEST_LINE:
                raise RecordingError(
                    f"{source.path}: a line is longer than {LONGEST_LINE} characters, the limit for a row"
                )
            yield text[:cut]
            rest = text[cut:]
    yield rest


def end_of_rows(source: Source, encoding: str, layout: Layout, start: int, size: int) -> tuple[int, int]:
    """Byte after the last row of a table that ends before ``size``, and the number of lines below it that are not rows:
    a remark or a truncated row, but not several rows of another width."""
    begin = max(start, size - TAIL_BYTES)
    begin += (begin - start) % (2 if encoding.startswith("utf-16") else 1)
    lines = [line for block in blocks_of(source, encoding, begin, size) for line in LINE.findall(block)][
        begin > start :
    ]

    def width(line: str) -> int:
        kinds = layout.dialect.kinds(line)
        return 0 if VALUES.isdisjoint(kinds) else len(kinds)

    below = [*takewhile(lambda line: width(line) < len(layout.columns), reversed(lines))]
    if len(below) == len(lines) or sum(width(line) > 0 for line in below) > MOST_TRUNCATED:
        return size, 0
    return size - sum(_size(line, encoding) for line in below), sum(bool(re.search(r"\w", line)) for line in below)
