"""Plain text of every kind: Arrow parses, after :mod:`piezo_model.recordings.dialect` found out how it is written.

Only when Arrow refuses a file is the text walked through once more, slowly, to name the first cell that is wrong and
its row as an editor shows it.
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
from piezo_model.recordings.chunks import RecordingError, first_line
from piezo_model.recordings.dialect import FLAGS, Layout, layout_of
from piezo_model.recordings.sampling_remark import sample_time_in
from piezo_model.recordings.tables import HEAD_BYTES, ReadOptions, Table
from piezo_model.recordings.text_rows import LINE, LONGEST_LINE, TextRows, end_of_rows

NAME = "plain text"
READS = ("header_row", "decimal")
SAMPLE_LINES = 1000
NULLS = ["", "NaN", "nan", "NAN", "NA", "N/A", "#N/A", "null", "None", "-", "--", "---", "#VALUE!"]
SEPARATOR_NAMES = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", " ": "blanks"}
ENCODING_NAMES = {"latin-1": "Latin-1", "utf-16-le": "UTF-16", "utf-16-be": "UTF-16"}


@dataclass(frozen=True)
class TextTable(Table):
    """A text file."""

    rows: TextRows

    def batches(self, at: Sequence[int]) -> Iterator[Sequence[NDArray]]:
        """Stream columns."""
        keys = [str(k) for k in range(len(self.columns))]  # names of the file may repeat or be empty
        clocks = {
            k: ClockReader(f"{self.path}: column {self.columns[k].name!r}", self.where)
            for k in at
            if self.columns[k].kind == "clock"
        }
        dialect = self.rows.layout.dialect
        options = {
            "read_options": arrow_csv.ReadOptions(use_threads=False, column_names=keys, block_size=LONGEST_LINE),
            "parse_options": arrow_csv.ParseOptions(delimiter="\t" if dialect.separator == " " else dialect.separator),
            "convert_options": arrow_csv.ConvertOptions(
                column_types={keys[k]: pa.string() if k in clocks else pa.float64() for k in at},
                include_columns=[keys[k] for k in at],
                null_values=NULLS,
                strings_can_be_null=True,
                decimal_point=dialect.decimal,
                check_utf8=False,
            ),
        }
        try:
            for block in filter(bytes.strip, self.rows.blocks()):
                for batch in arrow_csv.read_csv(pa.BufferReader(block), **options).to_batches():
                    yield [
                        clocks[k].times(column.to_pylist()) if k in clocks else numbers(column)
                        for k, column in zip(at, batch.columns, strict=True)
                    ]
        except (pa.ArrowException, OSError) as error:
            raise RecordingError(self._complaint([k for k in at if k not in clocks], error)) from None

    def where(self, row: int) -> str:
        """Row of the file (the line an editor shows) and data row, for a data row counted from 0."""
        for at, (number, _) in enumerate(self.rows.lines()):
            if at == row:
                return f"row {number} (data row {row + 1})"
        return f"data row {row + 1}"

    def _complaint(self, chosen: Sequence[int], error: Exception) -> str:
        """The sentence for the first row that cannot be read; Arrow's own where the text shows nothing wrong."""
        dialect = self.rows.layout.dialect
        try:
            for data_row, (number, line) in enumerate(self.rows.lines(), start=1):
                cells, place = dialect.split(line), f"row {number} (data row {data_row})"
                if len(cells) != len(self.columns):
                    return f"{self.path}: {place} has {len(cells)} columns where the others have {len(self.columns)}"
                for at in chosen:
                    cell = cells[at].strip()
                    if dialect.kind(cell) == "number" or cell in NULLS:
                        continue
                    said = f"{self.path}: column {self.columns[at].name!r} holds {_short(cell)} in {place}"
                    if dialect.decimal == "." and replace(dialect, decimal=",").kind(cell) == "number":
                        return f"{said}, a decimal comma where the other numbers have points"
                    return f"{said}, where a number is needed" + (", not a flag" if cell.lower() in FLAGS else "")
        except csv.Error as failure:
            error = failure
        return f"{self.path}: cannot be read as a table: {first_line(error)}"


def open_table(path: Path, reading: ReadOptions) -> TextTable:
    """Find encoding, dialect, header and the first and last row."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        whole = not file.read(1)
    encoding, mark = _encoding(path, head)
    lines = LINE.findall(head[mark:].decode(encoding, errors="replace"))
    if not whole and len(lines) > 1:
        lines = lines[:-1]
    elif not whole and len(head) >= min(HEAD_BYTES, LONGEST_LINE):
        raise RecordingError(f"{path}: row 1 is longer than {HEAD_BYTES} bytes, which no row of a table is")
    header = None if reading.header_row is None else reading.header_row - 1
    layout = layout_of(lines[:SAMPLE_LINES], reading.decimal, header) or layout_of(lines, reading.decimal, header)
    if layout is None:
        raise RecordingError(f"{path}: {_no_table(lines)}")
    _refuse_two_meanings_of_a_comma(path, lines, layout)
    start = mark + sum(len(line.encode(encoding, errors="replace")) for line in lines[: layout.start])
    start += len(lines[layout.start][: layout.glued].encode(encoding))
    stop, dropped = end_of_rows(path, encoding, layout, start)
    stated = sample_time_in(lines[: layout.start] if layout.header is None else lines[: layout.header])
    columns = tuple(replace(column, sample_time=stated) for column in layout.columns)
    return TextTable(path, _form(encoding, layout, dropped), columns, TextRows(path, encoding, layout, start, stop))


def _encoding(path: Path, head: bytes) -> tuple[str, int]:
    """Encoding, and bytes of the mark at the start."""
    for mark, encoding in (
        (codecs.BOM_UTF8, "utf-8"),
        (codecs.BOM_UTF16_LE, "utf-16-le"),
        (codecs.BOM_UTF16_BE, "utf-16-be"),
    ):
        if head.startswith(mark):
            return encoding, len(mark)
    sample = head[:4096]
    if b"\0" in head:
        for odd, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
            if sample[odd::2].count(0) > 0.9 * len(sample[odd::2]) and not sample[1 - odd :: 2].count(0):
                return encoding, 0
        raise RecordingError(f"{path}: is neither plain text nor in a known format")
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.end < len(head) - 4:  # else a character cut in two at the end of the head
            return "latin-1", 0
    return "utf-8", 0


def _no_table(lines: Sequence[str]) -> str:
    written = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not written:
        return "holds no table, only blank or comment lines"
    if len(written) == 1:
        return "has a header and no data rows"
    return "holds no rows of numbers in its first lines; --header-row says which row names the columns"


def _refuse_two_meanings_of_a_comma(path: Path, lines: Sequence[str], layout: Layout) -> None:
    if layout.header is not None or layout.dialect.separator != "," or not layout.start:
        return
    header, cells = layout.dialect.split(lines[layout.start - 1]), layout.dialect.split(lines[layout.start])
    if 1 < len(header) < len(cells) <= 2 * len(header) and all(re.fullmatch(r"[+-]?\d+", cell) for cell in cells):
        raise RecordingError(
            f"{path}: row {layout.start + 1} (data row 1) has {len(cells)} columns where the header has "
            f"{len(header)}; its numbers seem to have decimal commas, write decimal points"
        )


def _form(encoding: str, layout: Layout, dropped: int) -> str:
    rows = "line is incomplete and was" if dropped == 1 else f"{dropped} lines are incomplete and were"
    clauses = {
        "text" + (f" in {ENCODING_NAMES[encoding]}" if encoding in ENCODING_NAMES else ""): True,
        f"separated by {SEPARATOR_NAMES[layout.dialect.separator]}": True,
        "decimal comma": layout.dialect.decimal == ",",
        "no header" if layout.header is None else f"header in row {layout.header + 1}": True,
        "which holds the first row, too": layout.glued,
        f"the last {rows} left out": dropped,
    }
    return ", ".join(clause for clause, holds in clauses.items() if holds)


def _short(cell: str) -> str:
    return repr(cell if len(cell) <= 40 else cell[:37] + "…")
