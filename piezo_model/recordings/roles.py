"""Which column is time, input and output.

What the user names is taken. The rest is guessed and said, by what is surest first: the words in a name
(``input_voltage``), its unit, that only one column is left, and in the end the values
(:mod:`piezo_model.recordings.profile`).
Every word votes: for the drive (positive) or for the sensor (negative). Two columns that fit equally well are not
guessed: the user is asked.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.profile import Profile, input_first, profiles
from piezo_model.recordings.tables import Column, Table
from piezo_model.units import ANGLES, LENGTHS, SECONDS, VOLTAGES, seconds

TIME_WORDS = ("time", "t", "timestamp", "zeit", "clock", "elapsed", "datetime", "seconds", "x_value", "tempo", "temps")
WISHED = frozenset(
    {"reference", "ref", "desired", "target", "setpoint", "set", "commanded", "command", "cmd", "soll", "demand"}
)
"""A wish is never the output, and drives where nothing else does."""
VOTES: Mapping[str, int] = {
    **dict.fromkeys(
        (
            "drive",
            "driving",
            "input",
            "control",
            "excitation",
            "actuation",
            "amplifier",
            "amp",
            "dac",
            "ao",
            "piezo",
            "applied",
            "vin",
            "uin",
            "stimulus",
            "vpiezo",
            "upiezo",
            "vdrive",
            "stell",
            "actuator",
        ),
        3,
    ),
    **dict.fromkeys(("voltage", "volt", "volts", "spannung", "u", "v", "x", "hv"), 2),
    **dict.fromkeys(("field",), 1),
    **dict.fromkeys(
        (
            "sensor",
            "sens",
            "measured",
            "meas",
            "measurement",
            "actual",
            "feedback",
            "encoder",
            "interferometer",
            "laser",
            "lvdt",
            "sgs",
            "gauge",
            "adc",
            "ai",
            "ist",
            "capacitive",
            "response",
            "vout",
            "uout",
        ),
        -4,
    ),
    **dict.fromkeys(
        (
            "displacement",
            "disp",
            "displ",
            "output",
            "y",
            "stroke",
            "weg",
            "auslenkung",
            "extension",
            "elongation",
            "travel",
            "strain",
        ),
        -3,
    ),
    **dict.fromkeys(("position", "pos", "height", "deflection", "distance", "angle", "tilt", "z", "tip", "motion"), -2),
}
OTHERS = frozenset(
    {
        "temperature",
        "temp",
        "humidity",
        "pressure",
        "index",
        "sample",
        "samples",
        "nr",
        "number",
        "error",
        "err",
        "power",
        "segment",
        "state",
        "status",
        "trigger",
        "flag",
        "frequency",
        "force",
        "current",
        "charge",
        "row",
        "scan",
    }
)
"""Words of what a recording holds beside drive and sensor."""
KINDS = {"text": " (text)", "flag": " (flags)", "empty": " (empty)"}
NO_CLOCK = "none"
"""Said in place of a time column where there is none."""
ROLES = ("time", "input", "output", "reference")


@dataclass(frozen=True)
class Roles:
    """Position of the column of each role, and why it was guessed."""

    at: Mapping[str, int]
    reasons: Mapping[str, str]
    """By role; those that the user named are not in it."""
    unread: int | None = None
    """A column that its name calls the time, where the sampling period is given."""


@dataclass
class _Search:
    table: Table
    at: dict[str, int]
    reasons: dict[str, str] = field(default_factory=dict)

    @cached_property
    def free(self) -> list[int]:
        """Columns of numbers of one length; the length is that of the named ones, or of most columns."""
        columns = self.table.columns
        lengths = Counter(columns[k].rows for k in self.at.values()) or Counter(
            column.rows for column in columns if column.kind in ("number", "clock")
        )
        most = max(lengths, key=lambda rows: (lengths[rows], rows or 0), default=None)
        return [k for k, column in enumerate(columns) if column.kind in ("number", "clock") and column.rows == most]

    @cached_property
    def profiles(self) -> dict[int, Profile]:
        """Of the free columns."""
        return profiles(self.table, [k for k in self.free if self.table.columns[k].kind == "number"])

    def left(self) -> list[int]:
        """Free columns without a role."""
        return [k for k in self.free if k not in self.at.values()]

    def give(self, role: str, group: Sequence[int], reason: str) -> None:
        """Settle a role that is open where one column alone is left for it."""
        if role not in self.at and len(group) == 1:
            self.at[role], self.reasons[role] = group[0], reason


def choose_roles(table: Table, named: Mapping[str, str | None], sampled: bool = False) -> Roles:
    """Give every role its column.

    Parameters
    ----------
    table : Table
        Its values are looked at only where its names do not settle the matter.
    named : mapping of str to str or None
        By role (time, input and output, or time and reference) the column that the user named, or None to guess it.
    sampled : bool
        Whether the sampling period is known without a time column.

    Raises
    ------
    RecordingError
        A named column is not there or is named twice, or a role cannot be guessed.
    """
    if clockless := named.get("time") == NO_CLOCK:
        named = {**named, "time": None}
    if sampled and named.get("time") is not None:
        raise RecordingError(
            f"{table.path}: the sampling period is given, so that the time column {named['time']!r} would not be read; "
            "give one of the two"
        )
    search = _Search(table, {role: find(table, role, name) for role, name in named.items() if name is not None})
    if len(set(search.at.values())) < len(search.at):
        raise RecordingError(
            f"{table.path}: one column cannot serve as {' and '.join(search.at)}: "
            f"{', '.join(repr(named[role]) for role in search.at)}"
        )
    if "time" not in search.at and not clockless:
        _find_time_by_name(search)
    unread = search.at.get("time") if sampled else None
    if "reference" in named:
        _find_reference(search)
    else:
        _find_signals(search)
    missing = [role for role in named if role != "time" and role not in search.at]
    stated = all(table.columns[k].sample_time for role, k in search.at.items() if role != "time")
    if not (sampled or stated or "time" in search.at):
        if not clockless:
            _find_time_by_values(search)
        missing += ["time"] * ("time" not in search.at)
    if missing:
        raise RecordingError(_question(table, missing, list(named)))
    read = [role for role in ROLES if role in named and role in search.at and not (sampled and role == "time")]
    return Roles(
        {role: search.at[role] for role in read},
        {role: why for role, why in search.reasons.items() if role in read},
        unread,
    )


def find(table: Table, role: str, named: str) -> int:
    """Position of the column that the user means: by name, by the end of a path, without its unit, or by its number."""
    normal = partial(unicodedata.normalize, "NFKC")
    tests: tuple[Callable[[Column], bool], ...] = (
        lambda column: column.name == named,
        lambda column: normal(column.name).strip() == normal(named).strip(),
        lambda column: column.name.rpartition("/")[2] == named,
        lambda column: column.stem.casefold() == named.strip().casefold(),
    )
    for test in tests:
        same = [k for k, column in enumerate(table.columns) if test(column)]
        if len(same) > 1:
            raise RecordingError(
                f"{table.path}: has {len(same)} columns named {named!r}; --{role} takes a column's number, too"
            )
        if same:
            return same[0]
    if named.isdigit() and 1 <= int(named) <= len(table.columns):
        return int(named) - 1
    raise RecordingError(
        f"{table.path}: has no column {named!r} for the {role}; its columns are {_listed(table.columns)}"
    )


def vote(column: Column) -> int:
    """How much a name and its unit speak for a drive (positive) or a sensor (negative).

    >>> names = "input_voltage_V", "sensor_V", "height (piezo)", "height (measured)", "a"
    >>> [vote(Column.named(name)) for name in names]
    [6, -3, 1, -6, 0]
    """
    words = words_of(column)
    unit = (column.unit in VOLTAGES) - (column.unit in LENGTHS or column.unit in ANGLES)
    if words & WISHED:
        return 1 + max(unit, 0)
    return sum(VOTES.get(word, 0) for word in words) + unit


def words_of(column: Column) -> set[str]:
    """Words of a name without its unit; a letter counts only as the whole name: position_x is not an input."""
    stem = column.stem
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", stem)
    words = [word.casefold() for word in re.split(r"[\W_\d]+", parted) if word]
    return {word for word in words if len(word) > 1 or len(words) == 1}


def _find_time_by_name(search: _Search) -> None:
    ranks = {k: rank for k in search.left() if (rank := _time_rank(search.table.columns[k])) is not None}
    search.give("time", [k for k, rank in ranks.items() if rank == min(ranks.values())], "by name")


def _find_time_by_values(search: _Search) -> None:
    known = {k: search.profiles[k] for k in search.left() if k in search.profiles}
    rising = [k for k, profile in known.items() if profile.rises and not profile.counts]
    clocks = [k for k in search.left() if search.table.columns[k].kind == "clock"]
    search.give("time", clocks, "as the only clock")
    search.give("time", rising, "as the only one that never falls")
    search.give("time", [k for k in rising if known[k].uniform], "as the only one that rises evenly")


def _time_rank(column: Column) -> tuple[int, int] | None:
    stem = column.stem.casefold()
    if stem in TIME_WORDS:
        return (0, TIME_WORDS.index(stem))
    words = words_of(column)
    near = next(((1, at) for at, word in enumerate(TIME_WORDS) if word in words), None)
    return near or ((2, 0) if column.unit in SECONDS else None)


def _find_reference(search: _Search) -> None:
    left = search.left()
    columns = {k: search.table.columns[k] for k in left}
    wished = [k for k, column in columns.items() if words_of(column) & WISHED or column.stem == "r"]
    search.give("reference", wished, "by name")
    search.give("reference", [k for k, column in columns.items() if vote(column) < 0], "by name")
    search.give("reference", left, "as the only one left")


def _find_signals(search: _Search) -> None:
    columns = search.table.columns
    usual = [k for k in search.left() if not words_of(columns[k]) & OTHERS or vote(columns[k])]
    usual = [k for k in usual if columns[k].kind == "number"]
    _by_name(search, usual)
    if {"input", "output"} <= search.at.keys():
        return
    _find_time_by_values(search)
    known = {k: search.profiles[k] for k in search.left() if k in search.profiles}
    lively = [k for k, profile in known.items() if profile.high > profile.low and not profile.counts]
    usual = [k for k in usual if k in lively]
    _by_name(search, usual)
    for group in (usual, lively):
        left = [k for k in group if k not in search.at.values()]
        absent = [role for role in ("input", "output") if role not in search.at]
        if absent == ["input"] or (absent == ["output"] and not any(words_of(columns[k]) & WISHED for k in left)):
            search.give(absent[0], left, "as the only one left")
        elif len(absent) == len(left) == 2 and not all(vote(columns[k]) < 0 for k in left):
            pair, reason = input_first(search.table, (left[0], left[1]))
            for role, k in zip(absent, pair, strict=False):
                search.give(role, [k], reason)


def _by_name(search: _Search, usual: Sequence[int]) -> None:
    columns = search.table.columns
    votes = {k: vote(columns[k]) for k in usual if k not in search.at.values()}
    search.give("input", [k for k in votes if votes[k] == max(votes.values()) > 0], "by name")
    votes = {k: n for k, n in votes.items() if k not in search.at.values() and not words_of(columns[k]) & WISHED}
    search.give("output", [k for k in votes if votes[k] == min(votes.values()) < 0], "by name")


def _question(table: Table, missing: Sequence[str], asked: Sequence[str]) -> str:
    options = [f"--{role}" for role in asked]
    way_out = f"name them with {', '.join(options[:-1])} and {options[-1]}"
    if list(missing) == ["time"]:
        way_out = "name it with --time, or say --sample-time or --sample-rate if there is none"
    return (
        f"{table.path}: cannot tell which column is the {' and which the '.join(missing)}; its columns are "
        f"{_listed(table.columns)}; {way_out}"
    )


def seconds_per_unit(table: Table, column: Column) -> float:
    """Seconds in one unit of a time column; a name without unit means seconds, and so does a clock."""
    found = 1.0 if column.kind == "clock" else seconds(column.unit)
    if found is None:
        raise RecordingError(
            f"{table.path}: time column {column.name!r} is in {column.unit!r}, which is not a unit of time"
        )
    return found


def _listed(columns: Iterable[Column]) -> str:
    names = [repr(column.name) + KINDS.get(column.kind, "") for column in columns]
    return ", ".join(names if len(names) <= 24 else [*names[:24], f"and {len(names) - 24} more"])
