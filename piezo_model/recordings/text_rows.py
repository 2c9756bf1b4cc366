"""The rows of a text file as bytes that a CSV parser reads: whole lines in UTF-8, one separator, nothing but rows.

What a parser cannot know is taken away block by block: comments and repeated headers among the rows, runs of blanks,
marks between thousands, a remark or half a row at the end.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from piezo_model.recordings.chunks import BUFFER_BYTES, RecordingError
from piezo_model.recordings.dialect import Dialect

LONGEST_LINE = 1 << 20
LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
TAIL_BYTES = 1 << 16


@dataclass(frozen=True)
class TextRows:
    """Where the rows of a file are and how they are written."""

    path: Path
    encoding: str
    dialect: Dialect
    width: int
    """Cells of a row."""
    start: int
    """Byte of the first row."""
    stop: int
    """Byte after the last row."""
    lines_before: int
    """Lines of the file above the first row."""
    repeated: tuple[str, ...] = ()
    """Lines to be passed over wherever they come."""

    def blocks(self) -> Iterator[bytes]:
        """Rows as bytes in UTF-8, some whole lines at a time, cells parted by the parser's separator."""
        decoder = codecs.getincrementaldecoder(self.encoding)(errors="replace")
        keep = self.encoding in ("utf-8", "latin-1")  # the parser takes these bytes as they are
        held, left = b"", self.stop - self.start
        with self.path.open("rb") as file:
            file.seek(self.start)
            while left > 0:
                read = file.read(min(BUFFER_BYTES, left))
                if not read:
                    break
                left -= len(read)
                held += read if keep else decoder.decode(read).encode()
                cut = held.rfind(b"\n") + 1 or held.rfind(b"\r") + 1
                if cut and (block := self._cleaned(held[:cut])).strip():
                    yield block
                if cut:
                    held = held[cut:]
                elif len(held) > LONGEST_LINE:
                    raise RecordingError(
                        f"{self.path}: a line is longer than {LONGEST_LINE} characters, which no row of a table is"
                    )
        if held and (block := self._cleaned(held)).strip():
            yield block

    def lines(self) -> Iterator[tuple[int, str]]:
        """Number in the file and text of every row, as :meth:`blocks` gives them."""
        with self.path.open("rb") as file:
            file.seek(self.start)
            text = codecs.getreader(self.encoding)(file, "replace")
            for number, line in enumerate(text, start=self.lines_before + 1):
                if self._is_row(line):
                    yield number, line

    def decoded(self, cells: list[bytes | None]) -> list[str | None]:
        """Text of cells as :meth:`blocks` gives them."""
        return [None if cell is None else cell.decode(self._bytes_encoding, errors="replace") for cell in cells]

    def _is_row(self, line: str) -> bool:
        return bool(line.strip()) and not self.dialect.is_comment(line) and line.strip() not in self.repeated

    def _cleaned(self, block: bytes) -> bytes:
        marks = _MARKS[self.dialect.separator == ";" :]
        if any(mark in block for mark in marks):
            block = re.sub(rb"(?m)^[ \t]*(?:" + b"|".join(map(re.escape, marks)) + rb").*\r?\n?", b"", block)
        for line in self.repeated:
            if line.encode(self._bytes_encoding) in block:
                block = re.sub(
                    rb"(?m)^[ \t]*" + re.escape(line.encode(self._bytes_encoding)) + rb"[ \t]*\r?$\n?", b"", block
                )
        mark = self.dialect.thousands
        if mark:
            encoded = re.escape(mark.encode(self._bytes_encoding))
            digits = re.compile(rb"(?<=\d)" + encoded + rb"(?=\d{3}(?!\d))")
            block = (
                _QUOTED.sub(lambda cell: digits.sub(b"", cell[0]), block)
                if mark == self.dialect.separator
                else digits.sub(b"", block)
            )
        if self.dialect.separator == " ":
            block = _BLANKS.sub(b"\t", _MARGINS.sub(b"", block))
        return block

    @property
    def _bytes_encoding(self) -> str:
        return "latin-1" if self.encoding == "latin-1" else "utf-8"


_MARKS = (b";", b"#", b"%", b"//", b"!", b"**")
"""Of comments; the first may be a separator."""
_MARGINS = re.compile(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)")
_BLANKS = re.compile(rb"[ \t]+")
_QUOTED = re.compile(rb'"[^"\n]*"')


def end_of_rows(path: Path, encoding: str, dialect: Dialect, width: int, start: int) -> tuple[int, int]:
    """Byte after the last row, and how many lines below it are no rows: a remark, or a row that was cut off."""
    size = path.stat().st_size
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
        if holds and not dialect.is_comment(line) and len(cells) >= width:
            return stop, dropped
        dropped += bool(re.search(r"\w", line))
        stop -= len(line.encode(encoding, errors="replace"))
    return size, 0
