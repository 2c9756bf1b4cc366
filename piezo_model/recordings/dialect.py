"""How a text writes its cells: separator, decimal mark, and the kinds of values."""

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass

from piezo_model.recordings.clock_cells import is_clock
from piezo_model.recordings.table import Kind

SEPARATORS: Mapping[str, str] = {
    "\t": "tabs",
    ";": "semicolons",
    ",": "commas",
    "|": "bars",
    " ": "blanks",
    ", ": "commas with blanks",
}
"""Separators in the order of preference, and their names; " " means any run of blanks and tabs, and ", " a comma before
blanks, as multimeters write beside decimal commas."""
RUNS: Mapping[str, str] = {" ": r"[ \t]+", ", ": ", +"}
"""Separators that Arrow does not know; it gets tabs."""
COMMENT_MARKS = ("#", "%", "//", ";", "!", "**")
COMMENT = re.compile(rf"\s*(?:{'|'.join(map(re.escape, COMMENT_MARKS))})+\s*")
MISSING = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "#value!", "missing"})
NULLS = {case(cell) for cell in MISSING for case in (str.lower, str.upper, str.capitalize)} | {"NaN"}
"""The spellings of MISSING."""
FLAGS = frozenset({"true", "false", "yes", "no", "on", "off"})
DECIMAL = {
    mark: re.compile(rf"[+-]?(?:(?:\d++[{mark}]?\d*+|[{mark}]\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE)
    for mark in ".,"
}
LONGEST_VALUE = 100
"""Characters of a number or a clock; a longer cell is text, so that no hostile one is searched for long."""


@dataclass(frozen=True)
class Dialect:
    """How rows are written."""

    separator: str
    decimal: str

    def split(self, line: str) -> list[str]:
        """Cells of a line."""
        line = line.rstrip("\r\n")
        if self.separator in RUNS:
            return re.split(RUNS[self.separator], line.strip())
        return [cell.strip() for cell in cells_of(line.strip(" "), self.separator)]

    def is_comment(self, line: str) -> bool:
        """Whether a line is a comment; a leading semicolon may also be the separator after an empty first cell."""
        if self.separator == ";" and line.lstrip().startswith(";"):
            return not any(self.kind(cell) in ("number", "clock") for cell in self.split(line))
        return bool(COMMENT.match(line))

    def kind(self, cell: str) -> Kind:
        """Kind of value in a cell."""
        cell = cell.strip()
        if cell.lower() in MISSING:
            return "empty"
        if len(cell) > LONGEST_VALUE:
            return "text"
        if DECIMAL[self.decimal].fullmatch(cell):
            return "number"
        if cell.lower() in FLAGS:
            return "flag"
        if is_clock(cell):
            return "clock"
        return "text"


def cells_of(line: str, separator: str) -> list[str]:
    """Cells of a line with quotes; a line that has a cell beyond the parser's limit is one cell."""
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        return [line]
