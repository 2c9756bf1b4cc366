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

from piezo_model.recordings.table import Column, Profile, RecordingError, Table, printable
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
ROLES = ("time", "input", "output", "reference")


@dataclass(frozen=True)
class Roles:
    """Position of the column of each role, and the reasons of the guesses."""

    columns: Mapping[str, int]
    reasons: Mapping[str, str]
    """By role; not for roles that the user named."""
    unread: int | None = None
    """The time column by its name, if the sampling period is known without it."""


@dataclass
class _Search:
    table: Table
    assigned: dict[str, int]
    reasons: dict[str, str] = field(default_factory=dict)

    @cached_property
    def candidates(self) -> list[int]:
        """Columns of numbers with the length of the named columns, or with the most common length."""
        columns = self.table.columns
        lengths = Counter(columns[k].rows for k in self.assigned.values()) or Counter(
            column.rows for column in columns if column.kind in ("number", "clock")
        )
        commonest = max(lengths, key=lambda rows: (lengths[rows], rows or 0), default=None)
        return [
            k for k, column in enumerate(columns) if column.kind in ("number", "clock") and column.rows == commonest
        ]

    @cached_property
    def profiles(self) -> dict[int, Profile]:
        """Profiles of the candidates."""
        return self.table.profiles([k for k in self.candidates if self.table.columns[k].kind == "number"])

    def free(self) -> list[int]:
        """Candidates without a role."""
        return [k for k in self.candidates if k not in self.assigned.values()]

    def free_profiles(self) -> dict[int, Profile]:
        """Profiles of the candidates without a role."""
        return {k: self.profiles[k] for k in self.free() if k in self.profiles}

    def assign(self, role: str, columns: Sequence[int], reason: str) -> None:
        """Assign a column to a role that has none, if there is only one such column."""
        if role not in self.assigned and len(columns) == 1:
            self.assigned[role], self.reasons[role] = columns[0], reason


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
    if sampled and named.get("time") is not None:
        raise RecordingError(
            f"{table.path}: with a sampling period the time column {named['time']!r} would not be read; give one of "
            "the two"
        )
    search = _Search(table, {role: find(table, role, name) for role, name in named.items() if name is not None})
    if len(set(search.assigned.values())) < len(search.assigned):
        raise RecordingError(
            f"{table.path}: one column cannot serve as {' and '.join(search.assigned)}: "
            f"{', '.join(repr(named[role]) for role in search.assigned)}"
        )
    if "time" not in search.assigned and not clockless:
        _find_time_by_name(search)
    unread = search.assigned.get("time") if sampled else None
    if "reference" in named:
        _find_reference(search, clockless or sampled)
    else:
        _find_signals(search)
    missing = [role for role in named if role != "time" and role not in search.assigned]
    stated = all(table.columns[k].sample_time for role, k in search.assigned.items() if role != "time")
    if not (sampled or stated or "time" in search.assigned):
        if not clockless:
            _find_time_by_values(search)
        missing += ["time"] * ("time" not in search.assigned)
    if missing:
        raise RecordingError(_question(table, missing))
    read = [role for role in ROLES if role in named and role in search.assigned and not (sampled and role == "time")]
    return Roles(
        {role: search.assigned[role] for role in read},
        {role: why for role, why in search.reasons.items() if role in read},
        unread,
    )


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


def _find_time_by_name(search: _Search) -> None:
    ranks = {k: rank for k in search.free() if (rank := _time_rank(search.table.columns[k])) is not None}
    best = [k for k, rank in ranks.items() if rank == min(ranks.values())]
    if len(best) > 1 and len(set(search.table.profiles(best).values())) == 1:
        best = best[:1]  # an oscilloscope repeats the times next to each channel
    search.assign("time", best, "by name")


def _find_time_by_values(search: _Search) -> None:
    profiles = search.free_profiles()
    rising = [k for k, profile in profiles.items() if profile.rises and not profile.counts]
    clocks = [k for k in search.free() if search.table.columns[k].kind == "clock"]
    search.assign("time", clocks, "as the only clock")
    search.assign("time", rising, "as the only one that never falls")


def _time_rank(column: Column) -> int | None:
    """Rank of a name among those of time columns, best first; None for any other name."""
    whole, words = column.stem.casefold(), words_of(column)
    fits = [*(word == whole for word in TIME_WORDS), *(word in words for word in TIME_WORDS), column.unit in SECONDS]
    return fits.index(True) if any(fits) else None


def _find_reference(search: _Search, clockless: bool) -> None:
    columns = search.table.columns
    setpoints = [k for k in search.free() if is_setpoint(columns[k]) or columns[k].stem == "r"]
    search.assign("reference", setpoints, "by name")
    search.assign("reference", [k for k in search.free() if vote(columns[k]) < 0], "by name")
    if not clockless and len(search.free()) > 1 and not {"time", "reference"} <= search.assigned.keys():
        _find_time_by_values(search)
    search.assign("reference", search.free(), "as the only one left")


def _find_signals(search: _Search) -> None:
    columns = search.table.columns
    signals = [k for k in search.free() if columns[k].kind == "number" and _time_rank(columns[k]) is None]
    likely = [
        k
        for k in signals
        if columns[k].unit.casefold() not in OTHER_WORDS
        and (words_of(columns[k]).isdisjoint(OTHER_WORDS) or vote(columns[k]))
    ]
    _find_signals_by_name(search, likely)
    if {"input", "output"} <= search.assigned.keys():
        return
    _find_time_by_values(search)
    profiled = {k: profile for k, profile in search.free_profiles().items() if k in signals}
    varying = [k for k, profile in profiled.items() if profile.high > profile.low and not profile.counts]
    likely = [k for k in likely if k in varying]
    _find_signals_by_name(search, likely)
    for group in (likely, varying):
        free = [k for k in group if k not in search.assigned.values()]
        absent = [role for role in ("input", "output") if role not in search.assigned]
        if absent == ["input"] or (absent == ["output"] and not any(is_setpoint(columns[k]) for k in free)):
            search.assign(absent[0], free, "as the only one left")


def _find_signals_by_name(search: _Search, likely: Sequence[int]) -> None:
    columns = search.table.columns
    votes = {k: vote(columns[k]) for k in likely if k not in search.assigned.values()}
    highest = max(votes.values(), default=0)
    search.assign("input", [k for k in votes if votes[k] == highest > 0], "by name")
    votes = {k: n for k, n in votes.items() if k not in search.assigned.values() and not is_setpoint(columns[k])}
    lowest = min(votes.values(), default=0)
    search.assign("output", [k for k in votes if votes[k] == lowest < 0], "by name")


def _question(table: Table, missing: Sequence[str]) -> str:
    remedy = f"name {'it' if len(missing) == 1 else 'them'} with {' and '.join(f'--{role}' for role in missing)}"
    if list(missing) == ["time"]:
        remedy = "name it with --time, or give --sample-time or --sample-rate if there is none"
    return (
        f"{table.path}: cannot tell which column is the {' and which the '.join(missing)}; its columns are "
        f"{_listed(table)}; {remedy}"
    )


def _listed(table: Table) -> str:
    names = [repr(name) + KINDS.get(column.kind, "") for name, column in zip(table.names, table.columns, strict=True)]
    if len(names) > MOST_LISTED:
        names[MOST_LISTED:] = [f"and {len(names) - MOST_LISTED} more"]
    return ", ".join(names)
