"""The rows of a text file as bytes that a CSV parser reads: whole lines in UTF-8, one separator, nothing but rows.

What a parser cannot know is taken away block by block: comments and repeated headers among the rows, runs of blanks,
marks between thousands, a remark or half a row at the end.
"""

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from piezo_model.recordings.chunks import BUFFER_BYTES, RecordingError
from piezo_model.recordings.dialect import Layout

LONGEST_LINE = 1 << 20
LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
TAIL_BYTES = 1 << 16


@dataclass(frozen=True)
class TextRows:
    """Where the rows of a file are and how they are written."""

    path: Path
    encoding: str
    layout: Layout
    start: int
    """Byte of the first row."""
    stop: int
    """Byte after the last row."""

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
