"""Programs in MPS files with a quadratic section, QPS, as the Maros–Mészáros set was published in.

    minimise r + qᵀx + ½ xᵀP x   subject to   rows of kind E, L, G with ranges,  lb ≤ x ≤ ub

QUADOBJ (or QSECTION) lists one triangle of P, QMATRIX all of it. The reader is our own because the proof of an optimum is
about the data as they stand in the file: HiGHS, which reads these files too, drops coefficients up to 1e-9.

Conventions: the right-hand side of the objective is −r. A range R makes of L the interval [b − |R|, b], of G [b, b + |R|] and
of E [b, b + R] or [b + R, b]. An upper bound below zero without a lower bound makes the lower one −∞. Free rows after
the first are passed over. Fields are told by blanks, or by the columns of fixed format where names hold blanks.

Source: I. Maros, C. Mészáros, "A repository of convex quadratic programming problems", Optim. Methods Softw. 11 (1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from bench.problem_files.program import (
    ReadProgram,
    check_sides,
    checked,
    require,
    two_sided,
    with_infinities,
)

FIXED = (slice(1, 3), slice(4, 12), slice(14, 22), slice(24, 36), slice(39, 47), slice(49, 61))
QUADRATIC = ("QUADOBJ", "QSECTION", "QMATRIX")
SECTIONS = ("NAME", "OBJSENSE", "ROWS", "COLUMNS", "RHS", "RANGES", "BOUNDS", *QUADRATIC, "ENDATA")


def read_qps(path: Path) -> ReadProgram:
    """Read a QPS or MPS file; continuous variables only. ValueError says what is wrong, and in which line."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from None
    try:
        lines = content.decode("utf-8").splitlines()
    except UnicodeDecodeError:
        lines = content.decode("latin-1").splitlines()  # a character a byte, so that two names never become one
    try:
        return _Reading(fixed=False).take(lines)
    except ValueError as error:
        try:
            return _Reading(fixed=True).take(lines)
        except ValueError:
            raise error from None


class _Reading:
    """What has been read of a file so far."""

    def __init__(self, fixed: bool) -> None:
        self.fixed = fixed
        self.kinds: dict[str, str] = {}
        self.columns: dict[str, int] = {}
        self.linear: dict[tuple[str, str], float] = {}
        self.right: dict[str, float] = {}
        self.ranges: dict[str, float] = {}
        self.lower: dict[str, float] = {}
        self.upper: dict[str, float] = {}
        self.quadratic: dict[tuple[str, str], float] = {}
        self.sign = 1.0
        self.vectors: dict[str, str] = {}
        """Name of the one right-hand side, range and bound vector."""
        self.section = ""
        self.seen: set[str] = set()
        self.whole_P = False

    def take(self, lines: Sequence[str]) -> ReadProgram:
        for number, line in enumerate(lines, 1):
            if not line.strip() or line[0] == "*":
                continue
            try:
                if not line[0].isspace():
                    self._header(line.split())
                else:
                    self._line(line)
            except ValueError as error:
                raise ValueError(f"line {number}: {error}") from None
            if self.section == "ENDATA":
                return self._program()
        raise ValueError("ends without ENDATA")

    def _header(self, words: list[str]) -> None:
        self.section = words[0].upper()
        require(self.section in SECTIONS, f"the section {words[0]!r} is not one of {', '.join(SECTIONS)}")
        kind = "quadratic" if self.section in QUADRATIC else self.section
        require(kind not in self.seen, f"a second {kind} section")
        self.seen.add(kind)
        if self.section in QUADRATIC:
            self.whole_P = self.section == "QMATRIX"
        elif self.section == "OBJSENSE" and len(words) > 1:
            self._sense(words[1])

    def _line(self, line: str) -> None:
        words = line.split()
        if self.section == "OBJSENSE":
            self._sense(words[0])
        elif self.section == "ROWS":
            kind, name = (line[FIXED[0]].strip(), line[FIXED[1]].strip()) if self.fixed else _exactly(words, 2)
            require(kind.upper() in ("N", "E", "L", "G"), f"the kind of row {kind!r} is not one of N, E, L, G")
            _put(self.kinds, name, kind.upper(), "row")
        elif self.section == "BOUNDS":
            self._bound(*self._bound_fields(line, words))
        elif self.section in ("COLUMNS", "RHS", "RANGES", *QUADRATIC):
            head, pairs = self._pairs(line, words)
            for name, text in pairs:
                self._element(head, name, text)
        else:
            raise ValueError(f"data in the section {self.section or 'before any section'}")

    def _sense(self, word: str) -> None:
        require(word.upper() in ("MIN", "MINIMIZE", "MAX", "MAXIMIZE"), f"the sense {word!r} is neither MIN nor MAX")
        self.sign = -1.0 if word.upper().startswith("MAX") else 1.0

    def _pairs(self, line: str, words: list[str]) -> tuple[str, list[tuple[str, str]]]:
        """Head of a line, and its one or two pairs of name and number."""
        require("'MARKER'" not in words, "marks integer variables, and only continuous ones are taken")
        if self.fixed:
            _, head, *rest = (line[field].strip() for field in FIXED)
            return head, [(name, number) for name, number in zip(rest[::2], rest[1::2], strict=True) if name]
        head = words.pop(0) if len(words) % 2 else ""  # the name of a vector may be left out
        require(2 <= len(words) <= 4 and (head or self.section not in ("COLUMNS", *QUADRATIC)),
                "is no name followed by one or two pairs of name and number")
        return head, list(zip(words[::2], words[1::2], strict=True))

    def _element(self, head: str, name: str, text: str) -> None:
        value = _number(text)
        if self.section != "RANGES" and (self.section != "RHS" or self.kinds.get(name) in ("N", "E")):
            value = _finite(value, text)
        if self.section in QUADRATIC:
            for column in (head, name):
                require(column in self.columns, f"there is no column {column!r}")
            require(self.whole_P or head == name or (name, head) not in self.quadratic,
                    f"the element of {head!r} and {name!r} stands on both sides of the diagonal; that is QMATRIX")
            _put(self.quadratic, (head, name), value, "element")
            return
        require(name in self.kinds, f"there is no row {name!r}")
        if self.section == "COLUMNS":
            self.columns.setdefault(head, len(self.columns))
            _put(self.linear, (name, head), value, "element")
        else:
            self._only_vector(head)
            if self.section == "RHS" and with_infinities(value) == {"L": -np.inf, "G": np.inf}.get(self.kinds[name]):
                raise ValueError(f"no number is {text} or {'below' if value < 0.0 else 'beyond'}, which the row {name!r} asks for")
            _put(self.right if self.section == "RHS" else self.ranges, name, value, "row")

    def _only_vector(self, head: str) -> None:
        require(self.vectors.setdefault(self.section, head) == head, f"a second vector {head!r} in the section {self.section}")

    def _bound_fields(self, line: str, words: list[str]) -> tuple[str, str, str, str]:
        """Kind, vector, column and value."""
        if self.fixed:
            kind, head, column, value = (line[field].strip() for field in FIXED[:4])
            return kind, head, column, value
        kind, *rest = words
        if kind.upper() in ("FR", "MI", "PL"):  # without a value, though some files give one
            named = len(rest) > 1 and rest[1] in self.columns
            rest = [*rest[:1 + named], "0"]
        head = rest.pop(0) if len(rest) == 3 else ""
        column, value = _exactly(rest, 2)
        return kind, head, column, value

    def _bound(self, kind: str, head: str, column: str, text: str) -> None:
        self._only_vector(head)
        require(column in self.columns, f"there is no column {column!r}")
        kind = kind.upper()
        require(kind in ("FR", "MI", "PL", "LO", "UP", "FX"), f"the kind of bound {kind!r} is not one of LO, UP, FX, FR, MI, PL")
        value = 0.0 if kind in ("FR", "MI", "PL") else float(with_infinities(_number(text)))
        require(value != {"LO": np.inf, "UP": -np.inf}.get(kind) and not (kind == "FX" and np.isinf(value)),
                f"no number of the column {column!r} is within the bound {text}")
        if kind in ("FR", "MI", "LO", "FX"):
            self._side(self.lower, column, -np.inf if kind in ("FR", "MI") else value, "lower")
        if kind in ("FR", "PL", "UP", "FX"):
            self._side(self.upper, column, np.inf if kind in ("FR", "PL") else value, "upper")

    @staticmethod
    def _side(sides: dict[str, float], column: str, value: float, which: str) -> None:
        require(sides.setdefault(column, value) == value,
                f"the {which} bound of the column {column!r} is given twice, as {sides[column]:g} and as {value:g}")

    def _program(self) -> ReadProgram:
        objective = next((name for name, kind in self.kinds.items() if kind == "N"), None)
        d = len(self.columns)
        require(objective is not None and d, f"has no {'objective' if d else 'columns'}")
        rows = {name: i for i, name in enumerate(name for name, kind in self.kinds.items() if kind != "N")}
        q = np.zeros(d)
        for (row, column), value in self.linear.items():
            if row == objective:
                q[self.columns[column]] = value
        inside = [(rows[row], self.columns[column], value) for (row, column), value in self.linear.items() if row in rows]
        sides = np.array([_interval(self.kinds[name], self.right.get(name, 0.0), self.ranges.get(name)) for name in rows])
        l, u = sides.reshape(-1, 2).T  # noqa: E741
        lb, ub = np.zeros(d), np.full(d, np.inf)
        for column, i in self.columns.items():
            ub[i] = self.upper.get(column, np.inf)
            lb[i] = self.lower.get(column, -np.inf if ub[i] < 0.0 else 0.0)
        elements = [(self.columns[a], self.columns[b], value) for (a, b), value in self.quadratic.items()]
        if not self.whole_P:
            elements += [(j, i, value) for i, j, value in elements if i != j]
        check_sides(l=l, u=u, lb=lb, ub=ub)
        qp = two_sided(self.sign * _sparse(elements, (d, d)), self.sign * q, _sparse(inside, (len(rows), d)), l, u, lb, ub)
        return ReadProgram(checked(qp), -self.sign * self.right.get(str(objective), 0.0))


def _interval(kind: str, b: float, R: float | None) -> tuple[float, float]:
    if kind == "E":
        return (b, b) if R is None else (min(b, b + R), max(b, b + R))
    width = np.inf if R is None else abs(R)
    return (b - width, b) if kind == "L" else (b, b + width)


def _sparse(elements: Sequence[tuple[int, int, float]], shape: tuple[int, int]) -> csc_matrix:
    i, j, values = np.array(elements, dtype=np.float64).reshape(-1, 3).T
    return csc_matrix((values, (i.astype(np.int32), j.astype(np.int32))), shape=shape)


def _exactly(words: list[str], count: int) -> list[str]:
    require(len(words) == count, f"has {len(words)} fields where {count} are needed")
    return words


def _put(into: dict[Any, Any], name: Any, value: Any, what: str) -> None:
    require(name not in into, f"the {what} {name if isinstance(name, str) else ', '.join(name)} is given twice")
    into[name] = value


def _number(text: str) -> float:
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        value = np.nan
    require(not np.isnan(value) and "_" not in text, f"{text!r} is no number")
    return value


def _finite(value: float, text: str) -> float:
    require(not np.isinf(value), f"{text!r} is no finite number")
    return value
