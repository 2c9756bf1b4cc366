"""Programs in MPS files with a quadratic section (QPS), the original format of the Maros–Mészáros set.

    minimise r + qᵀx + ½ xᵀP x   subject to   rows of kind E, L, G with ranges,  lb ≤ x ≤ ub

QUADOBJ (or QSECTION, which may name the objective) lists one triangle of P, QMATRIX all of it; a quadratic constraint
is refused. The file is .qps, .mps or .sif, with .gz after it if it is compressed. The proof of an optimum needs the
exact data of the file, so the reader is our own: that of HiGHS drops coefficients up to 1e-9.

Conventions: the right-hand side of the objective is −r. A range R makes of L the interval [b − |R|, b], of G [b, b +
|R|] and of E [b, b + R] or [b + R, b]. An upper bound below zero without a lower bound makes the lower one −∞. Free
rows after the first are ignored. Fields are separated by blanks; names with blanks need the columns of fixed format.

Source: I. Maros, C. Mészáros, "A repository of convex quadratic programming problems", Optim. Methods Softw. 11 (1999).
"""

import gzip
from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from bench.problem_files.program import (
    MOST_BYTES,
    ReadProgram,
    about,
    check,
    check_sides,
    checked,
    two_sided,
    with_infinities,
)

FIXED = (slice(1, 3), slice(4, 12), slice(14, 22), slice(24, 36), slice(39, 47), slice(49, 61))
QUADRATIC = ("QUADOBJ", "QSECTION", "QMATRIX")
SECTIONS = ("NAME", "OBJSENSE", "ROWS", "COLUMNS", "RHS", "RANGES", "BOUNDS", *QUADRATIC, "ENDATA")
FIELDS = {"ROWS": (1,), "BOUNDS": (2, 3), "RHS": (2, 3, 4, 5), "RANGES": (2, 3, 4, 5)}
"""Allowed numbers of fields after the kind of row or bound, in sections other than three or five."""
SENSES = {"MIN": 1.0, "MINIMIZE": 1.0, "MAX": -1.0, "MAXIMIZE": -1.0}
WITHOUT_VALUE = ("FR", "MI", "PL")
BOUNDS = ("LO", "UP", "FX", *WITHOUT_VALUE)
Fields = tuple[str, str, list[tuple[str, str]]]
"""Kind of row or bound, first name, and pairs of a name and a number as text."""


def read_qps(path: Path) -> ReadProgram:
    """Read a QPS or MPS file of continuous variables. ValueError for an invalid file, with the line."""
    reading = about(path, "cannot be read: ", Exception)
    with reading, gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    check(len(content) <= MOST_BYTES, f"holds more than {MOST_BYTES} bytes of text")
    try:
        lines = content.decode("utf-8").splitlines()
    except UnicodeDecodeError:
        lines = content.decode("latin-1").splitlines()  # a character for each byte, so that columns stay in place
    try:
        return _Reader(fixed=False).read(lines)
    except ValueError:
        with suppress(ValueError):
            return _Reader(fixed=True).read(lines)
        raise


class _Reader:
    """The data of a file up to the current line."""

    def __init__(self, fixed: bool) -> None:
        self.fixed, self.section = fixed, ""
        self.kinds: dict[str, str] = {}
        """Kind of each row."""
        self.columns: dict[str, int] = {}
        self.values: dict[str, dict[Any, float]] = defaultdict(dict)
        """Numbers by section ("lower" and "upper" for BOUNDS), then by row, column or a pair of them."""
        self.vectors: dict[str, str] = {}
        """Name of the right-hand side, range and bound vector."""
        self.seen: dict[str, str] = {}
        """Sections so far, that of P under "quadratic"."""

    def read(self, lines: Sequence[str]) -> ReadProgram:
        for number, line in enumerate(lines, 1):
            if not line.strip() or line[0] == "*":
                continue
            try:
                self._line(line) if line[0].isspace() else self._header(*line.split(None, 1))
            except ValueError as error:
                raise ValueError(f"line {number}: {error}") from None
            if self.section == "ENDATA":
                return self._program()
        raise ValueError("ends without ENDATA")

    def _header(self, name: str, argument: str = "") -> None:
        self.section, argument = name.upper(), argument.strip()
        check(self.section in SECTIONS, f"the section {name!r} is not one of {', '.join(SECTIONS)}")
        allowed = {"NAME": argument, "OBJSENSE": argument, "QSECTION": self._objective}.get(self.section)
        check(
            argument in ("", allowed),
            f"{argument!r} follows {name}, "
            + (f"and only the objective, {allowed}, may be quadratic" if allowed else "which stands alone"),
        )
        kind = "quadratic" if self.section in QUADRATIC else self.section
        check(kind not in self.seen, f"a second {kind} section")
        self.seen[kind] = self.section
        if self.section == "OBJSENSE" and argument:
            self._line(argument)

    def _line(self, line: str) -> None:
        if self.section == "OBJSENSE":
            word = line.strip()
            check(word.upper() in SENSES, f"the sense {word!r} is neither MIN nor MAX")
            _put(self.values["OBJSENSE"], "of the objective", SENSES[word.upper()], "sense")
            return
        check(self.section not in ("", "NAME"), f"data in the section {self.section or 'before any section'}")
        kind, head, pairs = self._fields([line[field].strip() for field in FIXED] if self.fixed else line.split())
        if self.section in ("RHS", "RANGES", "BOUNDS"):
            vector = self.vectors.setdefault(self.section, head)
            check(vector == head, f"a second vector {head!r} in the section {self.section}")
        if self.section == "ROWS":
            check(kind.upper() in ("N", "E", "L", "G"), f"the kind of row {kind!r} is not one of N, E, L, G")
            _put(self.kinds, head, kind.upper(), "row")
        elif self.section == "BOUNDS":
            self._bound(kind.upper(), *pairs[0])
        else:
            for name, text in pairs:
                self._element(head, name, text)

    @property
    def _objective(self) -> str | None:
        """The first free row."""
        return next((name for name, kind in self.kinds.items() if kind == "N"), None)

    def _fields(self, words: list[str]) -> Fields:
        """The name of a vector is optional, and so is the value of a bound without one."""
        words = [word for word in words if word]
        check("'MARKER'" not in words, "marks integer variables, and only continuous ones are taken")
        counts, kind = FIELDS.get(self.section, (3, 5)), words.pop(0) if self.section in ("ROWS", "BOUNDS") else ""
        if kind.upper() in WITHOUT_VALUE and self.section == "BOUNDS":  # some files give one
            words = [*words[: 2 if len(words) > 1 and words[1] in self.columns else 1], "0"]
        check(len(words) in counts, f"has {len(words)} fields instead of {' or '.join(map(str, counts))}")
        head = words.pop(0) if len(words) % 2 else ""
        return kind, head, list(zip(words[::2], words[1::2], strict=True))

    def _element(self, head: str, name: str, text: str) -> None:
        value, quadratic = _number(text), self.section in QUADRATIC
        may_be_infinite = self.section == "RANGES" or (self.section == "RHS" and self.kinds.get(name) not in ("N", "E"))
        check(may_be_infinite or np.isfinite(value), f"{text!r} is not a finite number")
        for column in (head, name):
            check(not quadratic or column in self.columns, f"there is no column {column!r}")
        check(quadratic or name in self.kinds, f"there is no row {name!r}")
        check(
            not quadratic or self.section == "QMATRIX" or head == name or (name, head) not in self.values["quadratic"],
            f"the element of {head!r} and {name!r} stands on both sides of the diagonal; that is QMATRIX",
        )
        check(self.section != "RANGES" or self.kinds[name] != "N", f"the row {name!r} is of kind N and has no range")
        check(
            self.section != "RHS" or with_infinities(value) != {"L": -np.inf, "G": np.inf}.get(self.kinds[name]),
            f"no number is {text} or {'below' if value < 0.0 else 'beyond'}, which the row {name!r} asks for",
        )
        if self.section == "COLUMNS":
            self.columns.setdefault(head, len(self.columns))
        key = {"COLUMNS": (name, head), "RHS": name, "RANGES": name}.get(self.section, (head, name))
        what = "row" if key == name else "element"
        _put(self.values["quadratic" if quadratic else self.section], key, value, what)

    def _bound(self, kind: str, column: str, text: str) -> None:
        check(column in self.columns, f"there is no column {column!r}")
        check(kind in BOUNDS, f"the kind of bound {kind!r} is not one of {', '.join(BOUNDS)}")
        value = 0.0 if kind in WITHOUT_VALUE else float(with_infinities(_number(text)))
        check(
            value != {"LO": np.inf, "UP": -np.inf}.get(kind) and (kind != "FX" or np.isfinite(value)),
            f"no value of the column {column!r} satisfies the bound {text}",
        )
        sides = {
            "LO": {"lower": value},
            "UP": {"upper": value},
            "FX": {"lower": value, "upper": value},
            "MI": {"lower": -np.inf},
            "PL": {"upper": np.inf},
            "FR": {"lower": -np.inf, "upper": np.inf},
        }
        for which, side in sides[kind].items():
            before = self.values[which].setdefault(column, side)
            check(
                before == side,
                f"the {which} bound of the column {column!r} is given twice, as {before:g} and as {side:g}",
            )

    def _program(self) -> ReadProgram:
        objective, d, sign = self._objective, len(self.columns), self.values["OBJSENSE"].get("of the objective", 1.0)
        check(objective is not None and d, f"has no {'objective' if d else 'columns'}")
        linear, right, ranges, lower, upper = (
            self.values[name] for name in ("COLUMNS", "RHS", "RANGES", "lower", "upper")
        )
        rows = {name: i for i, name in enumerate(self.kinds)}
        C = _sparse(
            [(rows[row], self.columns[column], value) for (row, column), value in linear.items()], (len(rows), d)
        ).tocsr()
        limited = [name for name, kind in self.kinds.items() if kind != "N"]
        sides = np.array([_interval(self.kinds[name], right.get(name, 0.0), ranges.get(name)) for name in limited])
        l, u = sides.reshape(-1, 2).T  # noqa: E741
        ub = np.array([upper.get(column, np.inf) for column in self.columns])
        lb = np.array(
            [lower.get(column, -np.inf if high < 0.0 else 0.0) for column, high in zip(self.columns, ub, strict=True)]
        )
        elements = [(self.columns[a], self.columns[b], value) for (a, b), value in self.values["quadratic"].items()]
        if self.seen.get("quadratic") != "QMATRIX":
            elements += [(j, i, value) for i, j, value in elements if i != j]
        check_sides(l=l, u=u, lb=lb, ub=ub)
        q = sign * C[rows[str(objective)]].toarray()[0]
        P, C = sign * _sparse(elements, (d, d)), C[[rows[name] for name in limited]]
        return ReadProgram(checked(two_sided(P, q, C, l, u, lb, ub)), -sign * right.get(str(objective), 0.0), sign)


def _interval(kind: str, b: float, R: float | None) -> tuple[float, float]:
    if kind == "E":
        return (b, b) if R is None else (min(b, b + R), max(b, b + R))
    width = np.inf if R is None else abs(R)
    return (b - width, b) if kind == "L" else (b, b + width)


def _sparse(elements: Sequence[tuple[int, int, float]], shape: tuple[int, int]) -> csc_matrix:
    i, j, values = np.array(elements, dtype=np.float64).reshape(-1, 3).T
    return csc_matrix((values, (i.astype(np.int32), j.astype(np.int32))), shape=shape)


def _put(into: dict[Any, Any], name: Any, value: Any, what: str) -> None:
    check(name not in into, f"the {what} {name if isinstance(name, str) else ', '.join(name)} is given twice")
    into[name] = value


def _number(text: str) -> float:
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        value = np.nan
    check(not np.isnan(value) and "_" not in text, f"{text!r} is not a number")
    return value
