"""Assignment of the columns of a table to the roles time, input, output and reference.

Columns that the user does not name are guessed by the most reliable evidence available: the words in a name
(``input_voltage``), its unit, or being the only remaining column whose values vary or that can be a time. Guesses are
reported. Every word votes for the drive (positive) or for the sensor (negative). If two columns fit equally well, no
guess is made: the user has to name one.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from piezo_model.recordings.table import Column, RecordingError, Table, printable
from piezo_model.units import ANGLES, LENGTHS, SECONDS, VOLTAGES

TIME_WORDS = (
    "time",
    "t",
    "timestamp",
    "zeit",
    "clock",
    "elapsed",
    "datetime",
    "seconds",
    "x_value",
    "tempo",
    "temps",
    "second",
    "sec",
)
SETPOINT_WORDS = frozenset(
    re.split(" ", "reference ref desired target setpoint set commanded command cmd soll sollwert demand")
)
"""A setpoint is never the output, and the input only if nothing else is."""
VOTES: Mapping[str, int] = {
    word: vote
    for vote, words in {
        3: "drive driving input control excitation actuation amplifier amp dac ao piezo applied vin uin stimulus "
        "vpiezo upiezo vdrive stell actuator",
        2: "voltage volt volts spannung u v x hv",
        1: "field",
        -2: "position pos height deflection distance angle tilt z tip motion",
        -3: "displacement disp displ output y stroke weg auslenkung extension elongation travel strain",
        -4: "sensor sens measured meas measurement actual feedback encoder interferometer laser lvdt sgs gauge adc ai "
        "ist istwert capacitive response vout uout",
    }.items()
    for word in words.split()
}
OTHER_WORDS = frozenset(
    re.split(
        " ",
        "temperature temp humidity pressure index sample samples no nr number error err power segment state status "
        "trigger flag frequency force current charge row scan sequence",
    )
)
"""Words for columns other than drive and sensor."""
KINDS = {"text": " (text)", "flag": " (flags)", "empty": " (empty)"}
NO_CLOCK = "none"
"""Name that the user gives as the time column of a table without one."""
MOST_LISTED = 24
"""Most names in an error message."""


@dataclass
class Roles:
    """Position of the column of each role, and the reasons of the guesses."""

    table: Table
    columns: dict[str, int]
    """By role."""
    reasons: dict[str, str] = field(default_factory=dict)
    """By role; not for roles that the user named."""

    @cached_property
    def candidates(self) -> list[int]:
        """Columns of numbers with the length of the named columns, or with the most common length."""
        readable = [k for k, column in enumerate(self.table.columns) if column.kind in ("number", "clock")]
        lengths = Counter(self.table.columns[k].rows for k in self.columns.values() or readable)
        commonest = max(lengths, key=lambda rows: (lengths[rows], rows or 0), default=None)
        return [k for k in readable if self.table.columns[k].rows == commonest]

    @cached_property
    def rises(self) -> dict[int, bool]:
        """Whether the values never fall, of the candidates whose values vary and are not an index."""
        numbers = [k for k in self.candidates if self.table.columns[k].kind == "number"]
        steps = ((k, np.diff(head)) for k, head in self.table.heads(numbers).items())
        return {k: bool((of >= 0.0).all()) for k, of in steps if of.any() and not (of == 1.0).all()}

    def free(self) -> list[int]:
        """Candidates without a role."""
        return [k for k in self.candidates if k not in self.columns.values()]

    def assign(self, role: str, columns: Sequence[int], reason: str) -> None:
        """Assign a column to a role that has none, if only one of these columns is free."""
        free = [k for k in columns if k not in self.columns.values()]
        if role not in self.columns and len(free) == 1:
            self.columns[role], self.reasons[role] = free[0], reason


def choose_roles(table: Table, named: Mapping[str, str | None], sampled: bool = False) -> Roles:
    """Choose the column of every role.

    Parameters
    ----------
    table : Table
        Its values are read only if the names do not suffice.
    named : mapping of str to str or None
        By role (time, input and output, or time and reference) the column that the user named, or None to guess it.
    sampled : bool
        Whether the sampling period is known without a time column.

    Raises
    ------
    RecordingError
        A named column is absent or named twice, or a role cannot be guessed.
    """
    if clockless := named.get("time") == NO_CLOCK:
        named = {**named, "time": None}
    roles = Roles(table, {role: find(table, role, str(name)) for role, name in named.items() if name is not None})
    if len(set(roles.columns.values())) < len(roles.columns):
        raise RecordingError(
            f"{table.path}: one column cannot serve as {' and '.join(roles.columns)}: "
            f"{', '.join(repr(named[role]) for role in roles.columns)}"
        )
    if "time" not in roles.columns and not clockless:
        _find_time_by_name(roles)
    timed = "time" in roles.columns or not sampled
    if "reference" in named:
        _find_reference(roles, clockless or sampled)
    else:
        _find_signals(roles)
    missing = [role for role in named if role != "time" and role not in roles.columns]
    stated = all(table.columns[k].sample_time for role, k in roles.columns.items() if role != "time")
    if not (sampled or stated or "time" in roles.columns):
        if not clockless:
            _find_time_by_values(roles)
        missing += ["time"] * ("time" not in roles.columns)
    if missing:
        raise RecordingError(_question(table, missing))
    read = {role: roles.columns[role] for role in named if role in roles.columns and (timed or role != "time")}
    return Roles(table, read, {role: why for role, why in roles.reasons.items() if role in read})


def find(table: Table, role: str, named: str) -> int:
    """Position of a column that the user gives by its name, the end of its path, its name without unit, its number, or
    a part of its name that no other column has."""

    def normal(text: str) -> str:
        return printable(unicodedata.normalize("NFKC", text))

    columns = table.columns
    tests: tuple[Callable[[int], bool], ...] = (
        lambda k: columns[k].name == named,
        lambda k: normal(columns[k].name) == normal(named),
        lambda k: columns[k].name.rpartition("/")[2] == named,
        lambda k: columns[k].stem.casefold() == named.strip().casefold(),
        lambda k: named.isdigit() and k + 1 == int(named),
        lambda k: table.names[k] == named,
        lambda k: len(named) > 1 and normal(named).casefold() in normal(columns[k].name).casefold(),
    )
    for test in tests:
        same = [k for k in range(len(columns)) if test(k)]
        if len(same) > 1:
            raise RecordingError(
                f"{table.path}: has {len(same)} columns named {named!r}; --{role} also takes a column's number: "
                f"{', '.join(f'{k + 1} for {table.names[k]!r}' for k in same[:MOST_LISTED])}"
            )
        if same:
            return same[0]
    raise RecordingError(f"{table.path}: has no column {named!r} for the {role}; its columns are {_listed(table)}")


def vote(column: Column) -> int:
    """Vote of a name and its unit for a drive (positive) or a sensor (negative).

    >>> names = "input_voltage_V", "sensor_V", "height (piezo)", "height (measured)", "a"
    >>> [vote(Column.named(name)) for name in names]
    [6, -3, 1, -6, 0]
    """
    unit = (column.unit in VOLTAGES) - (column.unit in LENGTHS or column.unit in ANGLES)
    if is_setpoint(column):
        return 1 + max(unit, 0)
    return sum(VOTES.get(word, 0) for word in words_of(column)) + unit


def is_setpoint(column: Column) -> bool:
    """True if a column is a setpoint by its name."""
    return not words_of(column).isdisjoint(SETPOINT_WORDS)


def words_of(column: Column) -> set[str]:
    """Words of a name without its unit. A single letter counts only as the whole name, since position_x is not an
    input; x, y and z count only without a unit, since with one they are the axes of a stage."""
    separated = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", column.stem)
    words = [word.casefold() for word in re.split(r"[\W_\d]+", separated) if word]
    return {word for word in words if len(word) > 1 or (len(words) == 1 and not (column.unit and word in "xyz"))}


def _find_time_by_name(roles: Roles) -> None:
    ranks = {k: rank for k in roles.free() if (rank := _time_rank(roles.table.columns[k])) is not None}
    best = [k for k, rank in ranks.items() if rank == min(ranks.values())]
    if len(best) > 1 and len({head.tobytes() for head in roles.table.heads(best).values()}) == 1:
        best = best[:1]  # an oscilloscope repeats the times next to each channel
    roles.assign("time", best, "by name")


def _find_time_by_values(roles: Roles) -> None:
    roles.assign("time", [k for k in roles.candidates if roles.table.columns[k].kind == "clock"], "as the only clock")
    roles.assign("time", [k for k in roles.rises if roles.rises[k]], "as the only one that never falls")


def _time_rank(column: Column) -> int | None:
    """Rank of a name among those of time columns, best first; None for any other name."""
    whole, words = column.stem.casefold(), words_of(column)
    fits = [*(word == whole for word in TIME_WORDS), *(word in words for word in TIME_WORDS), column.unit in SECONDS]
    return fits.index(True) if any(fits) else None


def _find_reference(roles: Roles, clockless: bool) -> None:
    columns = roles.table.columns
    roles.assign("reference", [k for k in roles.free() if is_setpoint(columns[k]) or columns[k].stem == "r"], "by name")
    roles.assign("reference", [k for k in roles.free() if vote(columns[k]) < 0], "by name")
    if not clockless and len(roles.free()) > 1 and not {"time", "reference"} <= roles.columns.keys():
        _find_time_by_values(roles)
    roles.assign("reference", roles.free(), "as the only one left")


def _find_signals(roles: Roles) -> None:
    columns = roles.table.columns
    signals = [k for k in roles.free() if columns[k].kind == "number" and _time_rank(columns[k]) is None]
    likely = [
        k
        for k in signals
        if columns[k].unit.casefold() not in OTHER_WORDS
        and (words_of(columns[k]).isdisjoint(OTHER_WORDS) or vote(columns[k]))
    ]
    _find_signals_by_name(roles, likely)
    if {"input", "output"} <= roles.columns.keys():
        return
    _find_time_by_values(roles)
    likely = [k for k in likely if k in roles.rises]
    _find_signals_by_name(roles, likely)
    left = [k for k in likely if k in roles.free()]
    absent = [role for role in ("input", "output") if role not in roles.columns]
    if absent == ["input"] or (absent == ["output"] and not any(is_setpoint(columns[k]) for k in left)):
        roles.assign(absent[0], left, "as the only one left")


def _find_signals_by_name(roles: Roles, likely: Sequence[int]) -> None:
    columns = roles.table.columns
    votes = {k: vote(columns[k]) for k in likely if k not in roles.columns.values()}
    highest = max(votes.values(), default=0)
    roles.assign("input", [k for k in votes if votes[k] == highest > 0], "by name")
    votes = {k: n for k, n in votes.items() if k not in roles.columns.values() and not is_setpoint(columns[k])}
    lowest = min(votes.values(), default=0)
    roles.assign("output", [k for k in votes if votes[k] == lowest < 0], "by name")


def _question(table: Table, missing: Sequence[str]) -> str:
    remedy = (
        "name it with --time, or give --sample-time or --sample-rate if there is none"
        if list(missing) == ["time"]
        else f"name {'it' if len(missing) == 1 else 'them'} with {' and '.join(f'--{role}' for role in missing)}"
    )
    return (
        f"{table.path}: cannot tell which column is the {' and which the '.join(missing)}; its columns are "
        f"{_listed(table)}; {remedy}"
    )


def _listed(table: Table) -> str:
    names = [
        repr(name) + KINDS.get(column.kind, "") + f" of {column.rows} rows" * (column.rows != table.columns[0].rows)
        for name, column in zip(table.names, table.columns, strict=True)
    ]
    return ", ".join(names[:MOST_LISTED]) + f", and {len(names) - MOST_LISTED} more" * (len(names) > MOST_LISTED)
