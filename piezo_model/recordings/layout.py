"""How the cells of a text are written, and where its tables are: header, units and first row of numbers of each.

A table begins at a line of names, other than those of the previous table, above a row of numbers. So the names and
numbers of a preamble are a table of few rows, which belongs to the table below.

Every pair of separator and decimal mark is tried on the first lines. The best pair gives the rows of equal width with
the most numbers; the lines above the first of them are header, units and remarks. Settings that an oscilloscope writes
next to its first rows are columns of text.
"""

import csv
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from piezo_model.recordings.clock_cells import is_clock
from piezo_model.recordings.stated_period import period_in
from piezo_model.recordings.table import FEW_ROWS, Column, Kind, printable
from piezo_model.units import canonical

SEPARATORS: Mapping[str, str] = {
    "\t": "tabs",
    ";": "semicolons",
    ",": "commas",
    "|": "bars",
    " ": "blanks",
    ", ": "commas with blanks",
}
"""Separators in the order of preference, and their names; " " means any run of blanks and tabs, and ", " a comma
followed by blanks, as multimeters write with decimal commas."""
RUNS = {" ": re.compile(r"[ \t]+"), ", ": re.compile(r", +|,(?=[\r\n]|$)")}
"""Separators that Arrow does not know, and that are replaced by tabs."""
COMMENT_MARKS = ("#", "%", "//", ";", "!", "**")
COMMENT = re.compile(rf"\s*(?:{'|'.join(map(re.escape, COMMENT_MARKS))})+\s*")
MISSING = ("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "#value!", "missing", "∞", "-∞")
NULLS = {case(cell) for cell in MISSING for case in (str.lower, str.upper, str.capitalize)} | {"NaN"}
"""The spellings of MISSING."""
WORDS: Mapping[str, Kind] = {
    **dict.fromkeys(MISSING, "empty"),
    **dict.fromkeys(("true", "false", "yes", "no", "on", "off"), "flag"),
}
"""Kinds of cells by their words."""
DECIMAL = {
    mark: re.compile(rf"[+-]?(?:(?:\d++[{mark}]?\d*+|[{mark}]\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE)
    for mark in ".,"
}
LONGEST_VALUE = 100
"""Most characters of a number or a clock; a longer cell is text, so that hostile cells take no time."""
REMARKS_BELOW_HEADER = 2
VALUES: frozenset[Kind] = frozenset({"number", "clock"})
WORTH: Mapping[Kind, float] = {"number": 1.0, "clock": 1.0, "flag": 0.3, "empty": 0.1, "text": -0.5}
"""Score of a cell by its kind."""
LONGEST_UNIT = 12
"""Most characters of an unknown unit."""
LEAST_WRITTEN = 0.02
"""Smallest fraction of cells in a column that are not empty."""
SETTINGS = 40
"""Most rows next to which an oscilloscope writes its settings."""
REMARKS = 8
"""Lines above the first row that may recur between the parts of a recording."""
MARKS, LONGEST_TITLE = "[]<>=:*#%!/;, \t\r\n", 60
"""Characters that are stripped from a heading, and most characters of the rest."""
GCS_ENTRY = re.compile(r"^#\s*((?:NAME|UNIT)\d+)\s*=\s*(.*?)\s*$", re.MULTILINE)
"""Name or unit of a column in the header of PI's General Command Set array (PI manual SM146, section on GCS arrays)."""
LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
PLAIN = re.compile(r"[0-9+\-.,;|:eE\s]*")


@dataclass(frozen=True)
class Dialect:
    """How rows are written."""

    separator: str
    decimal: str

    def split(self, line: str) -> list[str]:
        """Cells of a line."""
        line = line.rstrip("\r\n")
        if self.separator in RUNS:
            return RUNS[self.separator].split(line.strip())
        return [cell.strip() for cell in cells_of(line.strip(" "), self.separator)]

    def is_comment(self, line: str) -> bool:
        """True if a line is a comment; a leading semicolon may also be the separator after an empty first cell."""
        if self.separator == ";" and line.lstrip().startswith(";"):
            return VALUES.isdisjoint(map(self.kind, self.split(line)))
        return bool(COMMENT.match(line))

    def kinds(self, line: str) -> list[Kind]:
        """Kinds of the cells of a line; none of a comment."""
        return [] if self.is_comment(line) else [self.kind(cell) for cell in self.split(line)]

    def kind(self, cell: str) -> Kind:
        """Kind of value in a cell."""
        cell = cell.strip()
        if (word := cell.lower()) in WORDS:
            return WORDS[word]
        if len(cell) > LONGEST_VALUE:
            return "text"
        if DECIMAL[self.decimal].fullmatch(cell):
            return "number"
        return "clock" if is_clock(cell) else "text"


def cells_of(line: str, separator: str) -> list[str]:
    """Cells of a line with quotes; a line with a cell beyond the parser's limit is one cell."""
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        return [line]


SPACED = Dialect(", ", ",")


@dataclass(frozen=True)
class Layout:
    """Positions of header and rows in the first lines of a file."""

    dialect: Dialect
    start: int
    """Index of the first line of numbers."""
    columns: tuple[Column, ...]
    """Named ``column 1``, ``column 2``, … if the file has no names."""
    header: int | None = None
    """Index of the line that names the columns."""
    remarks: frozenset[str] = frozenset()
    """The last lines above the first row, with every number as 0; they are skipped wherever they recur."""
    glued: int = 0
    """Character at which the first row starts in the header's line, if the line break after the header is missing."""
    quoted: bool = False
    """True if there are quotes in the first lines; otherwise quotes are ordinary characters."""


@dataclass
class Region:
    """A table among the lines of a file, including the lines above it."""

    line: int = 0
    begin: int = 0
    """Lines and bytes before it."""
    names: int = 0
    """Number of its lines above the one that names its columns."""
    title: str = ""
    """The text above its names."""
    rows: int = 0
    width: int = 0
    key: set[str] = field(default_factory=set)
    """The lines above its first row; with every number as 0 in those that do not name columns."""


def regions_of(blocks: Iterable[str], dialect: Dialect, size: Callable[[str], int] = len) -> list[Region]:
    """The tables among lines, which come in blocks of whole lines; ``size`` gives the bytes of a text in the file."""
    regions, above, line, begin, end = [Region()], list[tuple[int, str]](), 0, 0, (0, 0)
    for block in blocks:
        plain = bool(regions[-1].rows and not above and PLAIN.fullmatch(block))
        for text in [block] if plain else LINE.findall(block):
            kinds = [] if plain else dialect.kinds(text)
            names = _header_above(dialect, above, kinds, regions[-1])
            is_row = names is not None or "text" not in kinds or len(kinds) == regions[-1].width
            if plain or (is_row and not VALUES.isdisjoint(kinds)):
                key = {_key(dialect, row) for at, row in above if at == names or not dialect.is_comment(row)}
                if names is not None and not key <= regions[-1].key:
                    titles = [row for at, row in above if at < names and len(dialect.split(row)) == 1]
                    title = printable("".join(titles[-1:]).strip(MARKS))[:LONGEST_TITLE]
                    if regions[-1].rows < FEW_ROWS:
                        end = regions[-1].line, regions.pop().begin
                    regions.append(Region(*end, names - end[0], title, key=key))
                regions[-1].rows += (text.count("\n") or text.count("\r")) if plain else 1
                regions[-1].width = regions[-1].width or len(kinds)
                above = []
            elif re.search(r"\w", text):
                above = [*above[-SETTINGS:], (line, text)]
            line, begin = line + ((text.count("\n") or text.count("\r")) if plain else 1), begin + size(text)
            end = end if above else (line, begin)
    return regions


def _header_above(
    dialect: Dialect, above: Sequence[tuple[int, str]], kinds: Sequence[Kind], table: Region
) -> int | None:
    """The line that names the columns, among the last lines above a row of these kinds; None without one."""
    numbers, texts = sum(kind in VALUES for kind in kinds), kinds.count("text")
    for at, line in reversed(above[-REMARKS_BELOW_HEADER - 1 :] if numbers else ()):
        written = [name for name in _names(dialect, line, kinds) or () if dialect.kind(name) == "text"]
        split = len(dialect.split(_uncommented(dialect, line))) > 1 and not dialect.is_comment(line)
        if len(set(written)) > 1 and 2 * (len(written) - texts) >= numbers and (split or not table.rows):
            return at
    return None


def _key(dialect: Dialect, line: str) -> str:
    """A line of names, or any other line with every number as 0."""
    cells = dialect.split(line)
    return as_remark(line) if len(cells) == 1 or "number" in map(dialect.kind, cells) else line.strip()


def layout_of(
    lines: Sequence[str], decimal: str | None = None, header_row: int | None = None, first: int = 0
) -> Layout | None:
    """Find the table in the first complete lines of a file; None without rows of numbers.

    The user may give the decimal mark, and the row that names the columns, counted from 1, or 0 for none. Rows are
    looked for from the ``first`` line on.
    """
    first = header_row or first
    quoted = any('"' in line for line in lines)
    lines, stated = _without_settings(lines)
    spaced = decimal != "." and not quoted and _has_spaced_commas(lines[first:])
    dialects = (
        [SPACED]
        if spaced
        else [
            Dialect(separator, mark)
            for separator in SEPARATORS
            for mark in ([decimal] if decimal else ".,")
            if separator != SPACED.separator and (quoted or (separator, mark) != (",", ","))
        ]
    )
    score, dialect, rows = max(
        (_score(candidate, lines, first) for candidate in dialects), key=lambda scored: scored[0]
    )
    if score <= 0:
        return None
    kinds = tuple(map(_commonest, zip(*rows.values(), strict=True)))
    good = (
        k
        for k, row in rows.items()
        if all(kind not in VALUES or cell in (kind, "empty") for cell, kind in zip(row, kinds, strict=True))
    )
    start = next(good, min(rows))
    # a damaged row, or one with a remark behind it, is no header
    while ("number", "number") in zip(rows.get(start - 1, ()), kinds, strict=False) or (
        start > first and dialect.kinds(lines[start - 1])[: len(kinds)] == [*kinds]
    ):
        start -= 1
    header, names, units, glued = _headed(lines, dialect, start, kinds, header_row)
    if header_row and header != header_row - 1:
        return None
    top = lines[: header if glued else start]
    gcs = dict(GCS_ENTRY.findall("".join(top)))
    named = {
        **{k: (name or f"column {k + 1}", unit) for k, (name, unit) in enumerate(zip(names, units, strict=True))},
        **_named_by_settings([dialect.split(lines[k]) for k in rows][:SETTINGS], kinds),
        **{k: (gcs[f"NAME{k}"], gcs.get(f"UNIT{k}", "")) for k in range(len(kinds)) if f"NAME{k}" in gcs},
    }
    period = period_in([*top, *stated])
    return Layout(
        dialect,
        len(top),
        tuple(Column.named(*named[k], kind=kind, sample_time=period) for k, kind in enumerate(kinds)),
        header,
        frozenset(as_remark(line) for line in lines[max(0, start - REMARKS) : start] if "text" in dialect.kinds(line)),
        glued,
        quoted,
    )


def _has_spaced_commas(lines: Sequence[str]) -> bool:
    """True if commas before blanks separate cells and all others are decimal marks, unless a header has as many names
    as there are cells between commas of any kind."""
    rows = [line.strip() for line in lines if re.search(r"\d,\d", line)]
    widths = {len(line.split(",")) for line in lines if "," in line and line.strip() not in rows}
    cells = [cell for row in rows for cell in SPACED.split(row)]
    return (
        2 * len(rows) > len(lines)
        and all(", " in row and len(row.split(",")) not in widths for row in rows)
        and all(SPACED.kind(cell) == "number" for cell in cells if "," in cell)
        and not any(re.fullmatch(r"[+-]?\d*\.\d+", cell) for cell in cells)
    )


def _without_settings(lines: Sequence[str]) -> tuple[Sequence[str], list[str]]:
    """Lines without the start and increment of the times, which an oscilloscope (Rigol DS) writes to the right of names
    and units; and the increment as a remark."""
    for k, (names, units) in enumerate(pairwise(lines[:SETTINGS])):
        named = re.fullmatch(r"(X.*)([,;\t]) ?Start\2 ?Increment\2?\s*", names, re.IGNORECASE)
        below = named and re.fullmatch(r"(.*?)@([^@]+)@([^@]+)@?\s*".replace("@", named[2]), units)
        if named and below:
            return [*lines[:k], named[1], below[1], *lines[k + 2 :]], [f"dt = {below[3]}"]
    return lines, []


def as_remark(line: str) -> str:
    """A line with every number as 0, since the headings of parts differ in their numbers."""
    return re.sub(r"\d++", "0", line.strip())


def _score(dialect: Dialect, lines: Sequence[str], first: int) -> tuple[float, Dialect, dict[int, list[Kind]]]:
    """Score of the rows of the best width, the dialect, and the kinds of the cells of those rows."""
    rows: defaultdict[int, dict[int, list[Kind]]] = defaultdict(dict)
    scores: defaultdict[int, float] = defaultdict(float)
    for at, line in enumerate(lines[first:], start=first):
        kinds = dialect.kinds(line)
        if not VALUES.isdisjoint(kinds):
            rows[len(kinds)][at] = kinds
            scores[len(kinds)] += sum(WORTH[kind] for kind in kinds)
    width = max(scores, key=scores.__getitem__, default=0)
    return scores[width], dialect, rows[width]


def _commonest(kinds: Sequence[Kind]) -> Kind:
    """The commonest kind of a column; empty cells count only if nearly all are empty, or the others are of several
    kinds."""
    counts = Counter(kinds)
    written = counts.total() - counts["empty"]
    if counts["text"] and 2 * written < counts.total():
        return "text"
    if written < LEAST_WRITTEN * counts.total():
        return "empty"
    return max(counts, key=lambda kind: (kind != "empty", counts[kind], WORTH[kind]))


def _named_by_settings(rows: Sequence[Sequence[str]], kinds: Sequence[Kind]) -> dict[int, tuple[str, str]]:
    """Names and units of columns, from the settings that an oscilloscope (Tektronix TDS) writes next to the first rows,
    name and value in two columns to the left of time and signal."""
    columns: dict[int, tuple[str, str]] = {}
    for k in range(len(kinds) - 1):
        settings = {row[k]: row[k + 1] for row in rows} if kinds[k] == "text" else {}
        if "Vertical Units" in settings:
            numbers = [at for at in range(k + 2, len(kinds)) if kinds[at] == "number"]
            names = (
                ("Time", settings.get("Horizontal Units", "s")),
                (settings.get("Source", "signal"), settings["Vertical Units"]),
            )
            columns |= zip(numbers, names, strict=False)
    return columns


def _headed(
    lines: Sequence[str], dialect: Dialect, start: int, kinds: Sequence[Kind], header_row: int | None
) -> tuple[int | None, Sequence[str], Sequence[str], int]:
    """The line of names above the first row (it may be a comment, with a remark or a rule below it), names, units, and
    the character at which the first row starts in that line, or 0."""
    above = (
        [k for k in range(start) if re.search(r"\w", lines[k])][-REMARKS_BELOW_HEADER - 1 :]
        if header_row is None
        else [k for k in (header_row - 1, header_row) if header_row and k < start]  # names, and perhaps units
    )
    broken = any(lines[k].count('"') % 2 for k in above)  # a name in quotes has a line break
    headed = [
        (k, cells)
        for k in above
        if not broken and (cells := _names(dialect, lines[k], kinds, lines[start], bool(header_row)))
    ]
    none: Sequence[str] = [""] * len(kinds)
    if not headed and above and (glued := _glued(dialect, lines[above[-1]], kinds)):
        return above[-1], glued[0], none, glued[1]
    if not headed:
        return None, none, none, 0
    units = headed.pop()[1] if len(headed) > 1 and _all_units(headed[-1][1]) else none
    at, names = headed[-1] if header_row is None else headed[0]
    return at, names, units, 0


def _glued(dialect: Dialect, line: str, kinds: Sequence[Kind]) -> tuple[Sequence[str], int] | None:
    """Names in a header that is followed by the first row in the same line, as afmformats once wrote it, and the start
    of that row, at a number behind a letter of the last name."""
    text, cell = _uncommented(dialect, line), f"[^{re.escape(dialect.separator)}]*"
    last = rf"{cell}?[^\W\d](?=[+-]?[\d.])"
    joint = re.match(f"(?:{cell}{re.escape(dialect.separator)}){{{len(kinds) - 1}}}{last}", text)
    if joint is None or len(kinds) == 1 or dialect.kinds(text[joint.end() :]) != [*kinds]:
        return None
    return dialect.split(joint[0]), line.index(text) + joint.end()


def _all_units(cells: Sequence[str]) -> bool:
    """True if a row below the names holds units: at least one known unit without a slash, since u/V is a name, and
    others that are known, in brackets, or short if most are known."""
    known = [bool(canonical(cell)) or cell.strip("[]() ").lower() in ("", "-", "1", "sequence") for cell in cells]
    bracketed = [
        known_cell or bool(re.fullmatch(r"[\[(].*[\])]", cell)) for cell, known_cell in zip(cells, known, strict=True)
    ]
    short = 2 * sum(known) > len(cells) and max(map(len, cells)) <= LONGEST_UNIT
    return any(canonical(cell) and "/" not in cell for cell in cells) and (all(bracketed) or short)


def _uncommented(dialect: Dialect, line: str) -> str:
    line = line.strip("\r\n")
    return COMMENT.sub("", line, count=1) if dialect.is_comment(line) else line


def _names(dialect: Dialect, line: str, kinds: Sequence[Kind], row: str = "", stated: bool = False) -> list[str] | None:
    """The names in a line above columns of these kinds, and above their first row; None for a remark. Some may be
    numbers if the user states that the line holds names."""
    width = len(kinds)
    for names in _splits(dialect, _uncommented(dialect, line)):
        cells = [cell.strip().strip('"').strip() for cell in names]
        if len(cells) == width + 1 > 2:  # a separator at the end, or LabVIEW's comment that no row has
            cells = cells[:-1]
        if 1 < len(cells) < width and set(kinds[len(cells) :]) == {"empty"}:  # rows end in separators
            cells = [*cells, *[""] * (width - len(cells))]
        elif len(cells) == width - 1 > 1:  # rows start with an index, or the last column has no name
            own = (dialect.split(row) or [""])[0].strip('" ')
            cells = ["", *cells] if own.isdigit() or dialect.kind(own) == "text" else [*cells, ""]
        heads = [dialect.kind(cell) for cell in cells]
        named = stated and ("text", "number") in zip(heads, kinds, strict=False)
        if len(cells) == width and (named or VALUES.isdisjoint(heads)):
            return cells
    return None


def _splits(dialect: Dialect, text: str) -> list[list[str]]:
    """Ways to split a header: like the rows, at wide gaps, and at blanks that are not before a bracket."""
    wide, bare = re.split(r"\t+|\s{2,}", text.strip()), re.split(r"\s+(?![\[(])", text.strip())
    if dialect.separator == " ":
        return [
            wide,
            bare,
            *(cells_of(text, mark) for mark in ",;" if mark in text),
            re.findall(r'"[^"]*"', text),
        ]
    splits = [dialect.split(text)]
    if len(splits[0]) == 1:  # the header has another separator than the rows
        splits += [wide, bare, re.split(r"[,;]", text)]
    return splits
