"""The rows of a text file, parsed by Arrow: whole lines in UTF-8, one separator, nothing but rows.

Text that Arrow cannot parse is removed block by block: comments and repeated headers among the rows, runs of blanks,
thousands separators, a remark or half a row at the end. If Arrow refuses a block, a second and slower pass names the
first wrong cell and its row as an editor counts it.
"""

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray

from piezo_model.recordings.arrow_columns import ClockReader, numbers
from piezo_model.recordings.chunks import BUFFER_BYTES, RecordingError, first_line
from piezo_model.recordings.dialect import COMMENT_MARKS, FLAGS, NULLS, Layout
from piezo_model.recordings.tables import Table

LONGEST_LINE = 1 << 20
LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
TAIL_BYTES = 1 << 16
MARGINS = re.compile(r"^[ \t]+|(?<![ \t])[ \t]++(?=\r?$)", re.MULTILINE)
QUOTED = re.compile(r'"[^"\n]*"')


@dataclass(frozen=True)
class TextTable(Table):
    """A text file: where its rows are and how they are written."""

    encoding: str
    layout: Layout
    start: int
    """Byte of the first row."""
    stop: int
    """Byte after the last row."""

    def batches(self, at: Sequence[int]) -> Iterator[Sequence[NDArray]]:
        """Stream columns."""
        keys = [str(k) for k in range(len(self.columns))]  # names in the file may repeat or be empty
        clocks = {
            k: ClockReader(f"{self.path}: column {self.columns[k].name!r}", self.where)
            for k in at
            if self.columns[k].kind == "clock"
        }
        dialect = self.layout.dialect
        options = {
            "read_options": arrow_csv.ReadOptions(use_threads=False, column_names=keys, block_size=LONGEST_LINE),
            "parse_options": arrow_csv.ParseOptions(delimiter="\t" if dialect.separator == " " else dialect.separator),
            "convert_options": arrow_csv.ConvertOptions(
                column_types={keys[k]: pa.string() if k in clocks else pa.float64() for k in at},
                include_columns=[keys[k] for k in at],
                null_values=sorted(NULLS),
                strings_can_be_null=True,
                decimal_point=dialect.decimal,
                check_utf8=False,
            ),
        }
        try:
            for block in filter(str.strip, map(self._for_arrow, self._blocks())):
                for batch in arrow_csv.read_csv(pa.BufferReader(block.encode()), **options).to_batches():
                    yield [
                        clocks[k].times(column.to_pylist()) if k in clocks else numbers(column)
                        for k, column in zip(at, batch.columns, strict=True)
                    ]
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(self._complaint([k for k in at if k not in clocks], error)) from None

    def where(self, row: int) -> str:
        """Row of the file (the line an editor shows) and data row, for a data row counted from 0."""
        for at, (number, _) in enumerate(self._rows()):
            if at == row:
                return f"row {number} (data row {row + 1})"
        return f"data row {row + 1}"

    def _complaint(self, chosen: Sequence[int], error: Exception) -> str:
        """A sentence about the first row that cannot be read; Arrow's own if the text shows nothing wrong."""
        dialect = self.layout.dialect
        try:
            for data_row, (number, line) in enumerate(self._rows(), start=1):
                cells, place = dialect.split(line), f"row {number} (data row {data_row})"
                if len(cells) != len(self.columns):
                    return f"{self.path}: {place} has {len(cells)} columns where the others have {len(self.columns)}"
                for at in chosen:
                    cell = cells[at].strip()
                    if dialect.kind(cell) in ("number", "empty"):
                        continue
                    shown = repr(cell if len(cell) <= 40 else cell[:37] + "…")
                    start = f"{self.path}: column {self.columns[at].name!r} holds {shown} in {place}"
                    if dialect.decimal == "." and replace(dialect, decimal=",").kind(cell) == "number":
                        return f"{start}, a decimal comma where the other numbers have points"
                    return f"{start}, where a number is needed" + (", not a flag" if cell.lower() in FLAGS else "")
        except csv.Error as failure:
            error = failure
        return f"{self.path}: cannot be read as a table: {first_line(error)}"

    def _blocks(self) -> Iterator[str]:
        """The text from the first row to the last, in blocks of whole lines."""
        decoder = codecs.getincrementaldecoder(self.encoding)(errors="replace")
        rest = ""
        with self.path.open("rb") as file:
            file.seek(self.start)
            while data := file.read(min(BUFFER_BYTES, self.stop - file.tell())):
                rest += decoder.decode(data)
                cut = rest.rfind("\n") + 1 or rest.rfind("\r") + 1
                if cut:
                    yield rest[:cut]
                    rest = rest[cut:]
                elif len(rest) > LONGEST_LINE:
                    raise RecordingError(
                        f"{self.path}: a line is longer than {LONGEST_LINE} characters, which no row of a table is"
                    )
        yield rest

    def _rows(self) -> Iterator[tuple[int, str]]:
        """Number in the file and text of every row."""
        number = self.layout.start
        for block in self._blocks():
            for line in LINE.findall(block):
                number += 1
                if self._is_row(line):
                    yield number, line

    @cached_property
    def _comment_marks(self) -> tuple[str, ...]:
        """The marks that start a comment; the separator may also follow an empty first cell."""
        return tuple(mark for mark in COMMENT_MARKS if mark != self.layout.dialect.separator)

    def _is_row(self, line: str) -> bool:
        blank = line.isspace() if self.layout.dialect.separator == " " else not line.strip(" \r\n")
        comment = line.lstrip(" \t").startswith(self._comment_marks)
        return not blank and not comment and line.strip() not in self.layout.repeated

    def _for_arrow(self, block: str) -> str:
        """The rows of a block in the syntax of Arrow."""
        dialect = self.layout.dialect
        if any(text in block for text in (*self._comment_marks, *self.layout.repeated)):
            block = "".join(filter(self._is_row, LINE.findall(block)))
        if mark := dialect.thousands:
            group = re.compile(rf"(?<=\d){re.escape(mark)}(?=\d{{3}}(?!\d))")
            if mark == dialect.separator:
                block = QUOTED.sub(lambda cell: group.sub("", cell[0]), block)
            else:
                block = group.sub("", block)
        if dialect.separator == " ":
            block = re.sub(r"[ \t]+", "\t", MARGINS.sub("", block))
        return block


def end_of_rows(path: Path, encoding: str, layout: Layout, start: int) -> tuple[int, int]:
    """Byte after the last row, and the number of lines below it that are not rows: a remark, or a truncated row."""
    size, dialect = path.stat().st_size, layout.dialect
    bytes_per_unit = 2 if encoding.startswith("utf-16") else 1
    begin = max(start, size - TAIL_BYTES)
    begin += (begin - start) % bytes_per_unit
    with path.open("rb") as file:
        file.seek(begin)
        tail = file.read()
    lines = LINE.findall(tail.decode(encoding, errors="replace"))
    dropped, stop = 0, size
    for line in reversed(lines[begin > start :]):
        cells = dialect.split(line)
        has_values = any(dialect.kind(cell) in ("number", "clock") for cell in cells)
        if has_values and not dialect.is_comment(line) and len(cells) >= len(layout.columns):
            return stop, dropped
        dropped += bool(re.search(r"\w", line))
        stop -= len(line.encode(encoding, errors="replace"))
    return size, 0
