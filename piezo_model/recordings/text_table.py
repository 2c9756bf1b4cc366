"""The rows of a text file, parsed by Arrow: whole lines in UTF-8, one separator, nothing but rows.

What a parser cannot know is taken away block by block: comments and repeated headers among the rows, runs of blanks,
marks between thousands, a remark or half a row at the end. Only when Arrow refuses a block is the text walked through
once more, slowly, to name the first cell that is wrong and its row as an editor shows it.
"""

import codecs
import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray

from piezo_model.recordings.arrow_columns import ClockReader, numbers
from piezo_model.recordings.chunks import BUFFER_BYTES, RecordingError, first_line
from piezo_model.recordings.dialect import FLAGS, NULLS, Layout
from piezo_model.recordings.tables import Table

LONGEST_LINE = 1 << 20
LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
TAIL_BYTES = 1 << 16


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
        keys = [str(k) for k in range(len(self.columns))]  # names of the file may repeat or be empty
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
            for block in filter(bytes.strip, self.blocks()):
                for batch in arrow_csv.read_csv(pa.BufferReader(block), **options).to_batches():
                    yield [
                        clocks[k].times(column.to_pylist()) if k in clocks else numbers(column)
                        for k, column in zip(at, batch.columns, strict=True)
                    ]
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(self._complaint([k for k in at if k not in clocks], error)) from None

    def where(self, row: int) -> str:
        """Row of the file (the line an editor shows) and data row, for a data row counted from 0."""
        for at, (number, _) in enumerate(self.lines()):
            if at == row:
                return f"row {number} (data row {row + 1})"
        return f"data row {row + 1}"

    def _complaint(self, chosen: Sequence[int], error: Exception) -> str:
        """The sentence for the first row that cannot be read; Arrow's own where the text shows nothing wrong."""
        dialect = self.layout.dialect
        try:
            for data_row, (number, line) in enumerate(self.lines(), start=1):
                cells, place = dialect.split(line), f"row {number} (data row {data_row})"
                if len(cells) != len(self.columns):
                    return f"{self.path}: {place} has {len(cells)} columns where the others have {len(self.columns)}"
                for at in chosen:
                    cell = cells[at].strip()
                    if dialect.kind(cell) in ("number", "empty"):
                        continue
                    said = f"{self.path}: column {self.columns[at].name!r} holds {_short(cell)} in {place}"
                    if dialect.decimal == "." and replace(dialect, decimal=",").kind(cell) == "number":
                        return f"{said}, a decimal comma where the other numbers have points"
                    return f"{said}, where a number is needed" + (", not a flag" if cell.lower() in FLAGS else "")
        except csv.Error as failure:
            error = failure
        return f"{self.path}: cannot be read as a table: {first_line(error)}"

    def blocks(self) -> Iterator[bytes]:
        """Rows as bytes in UTF-8, some whole lines or none at a time, cells parted by the parser's separator."""
        decoder = codecs.getincrementaldecoder(self.encoding)(errors="replace")
        held = b""
        with self.path.open("rb") as file:
            file.seek(self.start)
            while read := file.read(min(BUFFER_BYTES, self.stop - file.tell())):
                held += decoder.decode(read).encode()
                cut = held.rfind(b"\n") + 1 or held.rfind(b"\r") + 1
                if cut:
                    yield self._cleaned(held[:cut])
                    held = held[cut:]
                elif len(held) > LONGEST_LINE:
                    raise RecordingError(
                        f"{self.path}: a line is longer than {LONGEST_LINE} characters, which no row of a table is"
                    )
        yield self._cleaned(held)

    def lines(self) -> Iterator[tuple[int, str]]:
        """Number in the file and text of every row, as :meth:`blocks` gives them."""
        with self.path.open("rb") as file:
            file.seek(self.start)
            text = codecs.getreader(self.encoding)(file, "replace")
            for number, line in enumerate(text, start=self.layout.start + 1):
                if self._is_row(line):
                    yield number, line

    def _is_row(self, line: str) -> bool:
        layout = self.layout
        return bool(line.strip()) and not layout.dialect.is_comment(line) and line.strip() not in layout.repeated

    def _cleaned(self, block: bytes) -> bytes:
        dialect = self.layout.dialect
        marks = _MARKS[dialect.separator == ";" :]
        if any(mark in block for mark in marks):
            block = re.sub(rb"(?m)^[ \t]*(?:" + b"|".join(map(re.escape, marks)) + rb").*\r?\n?", b"", block)
        for line in self.layout.repeated:
            if line.encode() in block:
                block = re.sub(rb"(?m)^[ \t]*" + re.escape(line.encode()) + rb"[ \t]*\r?$\n?", b"", block)
        mark = dialect.thousands
        if mark:
            digits = re.compile(rb"(?<=\d)" + re.escape(mark.encode()) + rb"(?=\d{3}(?!\d))")
            block = (
                _QUOTED.sub(lambda cell: digits.sub(b"", cell[0]), block)
                if mark == dialect.separator
                else digits.sub(b"", block)
            )
        if dialect.separator == " ":
            block = _BLANKS.sub(b"\t", _MARGINS.sub(b"", block))
        return block


_MARKS = (b";", b"#", b"%", b"//", b"!", b"**")
"""Of comments; the first may be a separator."""
_MARGINS = re.compile(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)")
_BLANKS = re.compile(rb"[ \t]+")
_QUOTED = re.compile(rb'"[^"\n]*"')


def end_of_rows(path: Path, encoding: str, layout: Layout, start: int) -> tuple[int, int]:
    """Byte after the last row, and how many lines below it are not rows: a remark, or a row that was cut off."""
    size, dialect = path.stat().st_size, layout.dialect
    wide = 2 if encoding.startswith("utf-16") else 1
    begin = max(start, size - TAIL_BYTES)
    begin += (begin - start) % wide
    with path.open("rb") as file:
        file.seek(begin)
        tail = file.read()
    lines = LINE.findall(tail.decode(encoding, errors="replace"))
    dropped, stop = 0, size
    for line in reversed(lines[begin > start :]):
        cells = dialect.split(line)
        holds = any(dialect.kind(cell) in ("number", "clock") for cell in cells)
        if holds and not dialect.is_comment(line) and len(cells) >= len(layout.columns):
            return stop, dropped
        dropped += bool(re.search(r"\w", line))
        stop -= len(line.encode(encoding, errors="replace"))
    return size, 0


def _short(cell: str) -> str:
    return repr(cell if len(cell) <= 40 else cell[:37] + "…")
