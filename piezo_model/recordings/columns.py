"""Which column is time, input and output, and in which unit, read from the names in a header.

A name is a stem and a unit: ``voltage_V``, ``Weg [µm]``, ``time (ms)``, ``U/V``. A role goes to the column whose stem
is one of the role's words; failing that to one with such a word in it (``input_voltage``); failing that to one in a
unit of the role. Two columns that fit equally well are no guess: the user is asked.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from piezo_model.recordings.pieces import RecordingError
from piezo_model.recordings.tables import Table

SECONDS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
VOLTAGES = ("V", "mV", "kV")
LENGTHS = ("um", "nm", "mm", "pm", "m")
UNITS = (*SECONDS, *VOLTAGES, *LENGTHS, "A", "mA", "N", "mN", "rad", "mrad", "urad", "deg")
"""Units known as a bare suffix; in brackets any unit is taken."""
SPELLINGS = {"sec": "s", "v": "V", "UM": "um", "NM": "nm"}


@dataclass(frozen=True)
class Role:
    """What a column is for, and how to recognise one."""

    name: str
    words: tuple[str, ...]
    units: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()
    """Words that rule a column out: the commanded position is no output."""


WISHED = ("reference", "ref", "desired", "target", "setpoint", "commanded", "command")
TIME = Role("time", ("time", "t", "timestamp", "zeit", "clock"), tuple(SECONDS))
INPUT = Role("input", ("voltage", "u", "input", "drive", "command", "control", "v", "x"), VOLTAGES)
OUTPUT = Role("output", ("displacement", "y", "output", "position", "sensor", "stroke", "measured", "deflection"),
              LENGTHS, foreign=WISHED)
REFERENCE = Role("reference", (*WISHED, *OUTPUT.words, "y_ref", "r"), LENGTHS)


def split_unit(column: str) -> tuple[str, str]:
    """Stem and unit of a column name; the unit is "" where the name has none, and µ is written u.

    >>> split_unit("displacement_um"), split_unit("Weg [µm]"), split_unit("u(V)"), split_unit("position_x")
    (('displacement', 'um'), ('Weg', 'um'), ('u', 'V'), ('position_x', ''))
    """
    plain = column.replace("µ", "u").replace("μ", "u").strip()
    bracketed = re.fullmatch(r"(.*?)[\s_]*(?:\[([^\[\]]*)\]|\(([^()]*)\))", plain)
    if bracketed:
        stem, unit = bracketed[1], (bracketed[2] or bracketed[3] or "").strip()
        return stem, SPELLINGS.get(unit, unit)
    suffixed = re.fullmatch(r"(.+?)\s*[_/\s]\s*([^\W_]+)", plain)
    if suffixed:
        unit = SPELLINGS.get(suffixed[2], suffixed[2])
        if unit in UNITS:
            return suffixed[1], unit
    return plain, ""


def seconds_per_unit(table: Table, column: str) -> float:
    """Seconds in one unit of a time column; a name without unit means seconds."""
    unit = split_unit(column)[1]
    if unit and unit not in SECONDS:
        raise RecordingError(f"{table.path}: time column {column!r} is in {unit!r}; known are {', '.join(SECONDS)}")
    return SECONDS[unit or "s"]


def choose(table: Table, roles: Mapping[Role, str | None]) -> tuple[dict[str, str], dict[str, str]]:
    """Give every role its column.

    Parameters
    ----------
    table : Table
        Only its path and column names are looked at.
    roles : mapping of Role to str or None
        The column that the user named, or None to guess it.

    Returns
    -------
    chosen, guesses : dict of str to str
        Column by role name: of all roles, and of the guessed ones.

    Raises
    ------
    RecordingError
        A named column is not there or is named twice, or a role cannot be guessed.
    """
    chosen = {role.name: _find(table, role, named) for role, named in roles.items() if named is not None}
    if len(set(chosen.values())) < len(chosen):
        raise RecordingError(f"{table.path}: one column cannot serve as {' and '.join(chosen)}: "
                             f"{', '.join(map(repr, chosen.values()))}")
    guesses: dict[str, str] = {}
    for role in roles:
        if role.name not in chosen:
            free = [column for column in table.columns if column not in chosen.values()]
            others = [other for other in roles if other is not role and other.name not in chosen]
            chosen[role.name] = guesses[role.name] = _guess(table, role, others, free, list(roles))
    return {role.name: chosen[role.name] for role in roles}, guesses


def _find(table: Table, role: Role, named: str) -> str:
    same = [column for column in table.columns if column == named]
    same = same or [column for column in table.columns if _normal(column) == _normal(named)]
    if not same:
        raise RecordingError(f"{table.path}: has no column {named!r} for the {role.name}; its columns are "
                             f"{_listed(table.columns)}")
    if len(same) > 1:
        raise RecordingError(f"{table.path}: has {len(same)} columns named {named!r}")
    return same[0]


def _guess(table: Table, role: Role, others: Sequence[Role], free: Sequence[str], asked: Sequence[Role]) -> str:
    ranked = sorted((rank, column) for column in free if (rank := _rank(role, column, others)) is not None)
    if ranked and (len(ranked) == 1 or ranked[0][0] < ranked[1][0]):
        return ranked[0][1]
    if role is REFERENCE and len(free) == 1:
        return free[0]
    options = [f"--{other.name}" for other in asked]
    raise RecordingError(f"{table.path}: cannot tell which column is the {role.name}; its columns are "
                         f"{_listed(table.columns)}; name them with {', '.join(options[:-1])} and {options[-1]}")


def _rank(role: Role, column: str, others: Sequence[Role]) -> tuple[int, int] | None:
    """How well a column fits a role, smallest best, or None."""
    by_name = _rank_by_name(role, column)
    if by_name is not None:
        return by_name
    claimed = any(_rank_by_name(other, column) is not None for other in others)
    words = _words(split_unit(column)[0])
    if split_unit(column)[1] in role.units and not claimed and not words & set(role.foreign):
        return (2, 0)
    return None


def _rank_by_name(role: Role, column: str) -> tuple[int, int] | None:
    stem = split_unit(column)[0]
    words = _words(stem)
    if words & set(role.foreign):
        return None
    for at, word in enumerate(role.words):
        if stem.casefold() == word:
            return (0, at)
    # A single letter counts only as the whole name: position_x is no input.
    return next(((1, at) for at, word in enumerate(role.words) if len(word) > 1 and word in words), None)


def _words(stem: str) -> set[str]:
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", stem)
    return {word.casefold() for word in re.split(r"[\W_]+", parted) if word}


def _normal(name: str) -> str:
    return unicodedata.normalize("NFKC", name).strip()


def _listed(columns: Sequence[str]) -> str:
    return ", ".join(repr(column) for column in columns)
