"""From a file to samples: the table of its format, the roles of its columns, the rows that are wanted, and a question
where the numbers cannot be in their units."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from piezo_model.recordings.evidence import ROWS
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.order import refuse_sorted
from piezo_model.recordings.roles import NO_CLOCK, Roles, choose_roles
from piezo_model.recordings.rows import Rows
from piezo_model.recordings.samples import Sampling, sample
from piezo_model.recordings.table import ABSURD, RecordingError, Table
from piezo_model.units import LENGTHS, PREFIXES, VOLTAGES, canonical, quantity, seconds
from solvers.arrays import Vector

CLOCK_TOLERANCE = 0.01
"""Largest relative difference between the duration by a time column and by a given sampling period."""
MOST_VOLTS, MOST_METRES, LONGEST_PERIOD_S = 1e4, 1.0, 60.0
"""Largest voltage, travel and sampling period that need no confirmation."""
GUESS = " (seconds are a guess, otherwise --time-unit)"
PREFIX = {"p": 1e-12, **PREFIXES}


def open_table(path: str | Path, options: ReadOptions | None = None) -> Table:
    """Open a table of any known format; see :func:`piezo_model.recordings.formats.open_table`."""
    from piezo_model.recordings import formats  # imports pyarrow

    return formats.open_table(path, options)


@dataclass(frozen=True)
class Signals:
    """Even samples of some roles."""

    table: Table
    roles: Roles
    rows: Rows
    sampling: Sampling
    units: tuple[str, ...]
    """Of the signals, "" for one that is not known."""
    guessed_seconds: bool
    """Whether nobody states the unit of the times."""

    def source(self, name: str) -> dict[str, Any]:
        """Fields of a `Source`."""
        return {
            "name": name,
            "sample_time": self.sampling.period,
            "columns": {role: self.table.names[k] for role, k in self.roles.at.items()},
            "reasons": self.roles.reasons,
            "form": self.table.form,
            "remarks": (*self.table.repairs, *self.rows.remarks, *self.rows.repairs),
            "guessed_seconds": self.guessed_seconds,
        }


def read_signals(table: Table, named: Mapping[str, str | None], options: ReadOptions) -> Signals:
    """Read the signals of a table.

    Parameters
    ----------
    table : Table
        An opened file.
    named : mapping of str to str or None
        By role the column that the user named, or None to guess it; the time comes first.
    options : ReadOptions
        What the user says about the file.

    Raises
    ------
    RecordingError
        Roles that cannot be told, rows that cannot be read or repaired, or numbers that are to be confirmed.
    """
    if options.strict and table.repairs:
        raise RecordingError(f"{table.path}: {table.repairs[0]}; without --strict that is accepted")
    try:
        roles = choose_roles(table, named, options.sample_time is not None)
    except RecordingError:
        _refuse_sorted_columns(table, named)
        raise
    time, signals = roles.at.get("time"), [k for role, k in roles.at.items() if role != "time"]
    if time is None and options.resample is not None:
        raise RecordingError(f"{table.path}: --resample needs a time column, and there is none; name it with --time")
    unit = 1.0 if time is None else seconds_per_unit(table, time, options)
    period = options.sample_time or table.columns[signals[0]].sample_time or 1.0
    wanted = _wanted(table, time, unit, period, options)
    at = [k for k in (time, *signals, roles.unread) if k is not None]
    columns = dict(zip(at, table.read(at, wanted), strict=True))
    first, step = wanted.start or 0, wanted.step or 1
    rows = Rows(
        table.path,
        [f"column {table.names[k]!r}" for k in signals],
        [columns[k] for k in signals],
        lambda row: table.where(first + step * row),
        "" if time is None else f"time column {table.names[time]!r}",
        None if time is None else columns[time],
    )
    if wanted != slice(None):
        rows.remarks.append(f"read from {rows.where(0)} on" + f", one row in {step}" * (step > 1))
    if roles.unread is not None:
        _refuse_other_clock(table, roles.unread, columns[roles.unread], period * step, options)
    del columns
    sampling = sample(rows, unit, period * step, options)
    guessed = (
        time is not None
        and table.columns[time].kind == "number"
        and not (table.columns[time].unit or options.time_unit)
    )
    if (
        time is not None
        and options.resample is None
        and options.time_unit is None
        and table.columns[time].kind == "number"
    ):
        _question_period(f"{table.path}: {rows.time_label}", sampling.period, guessed)
    units = []
    for k, role, values in zip(signals, (role for role in roles.at if role != "time"), rows.signals, strict=True):
        given = options.input_unit if role == "input" else options.output_unit
        units.append(table.columns[k].unit if given is None else canonical(given) or given.strip())
        if given is None:
            _question_scale(table.label(k), role, units[-1], values)
    return Signals(table, roles, rows, sampling, tuple(units), guessed)


def _refuse_sorted_columns(table: Table, named: Mapping[str, str | None]) -> None:
    """Refuse a table without times whose rows are sorted, so that a period would not help."""
    try:
        roles = choose_roles(table, {**named, "time": NO_CLOCK}, sampled=True)
    except RecordingError:  # the first error asks for what is missing
        return
    signals = table.read([*roles.at.values()], slice(ROWS))
    refuse_sorted(Rows(table.path, [f"column {table.names[k]!r}" for k in roles.at.values()], signals, table.where))


def seconds_per_unit(table: Table, time: int, options: ReadOptions) -> float:
    """Seconds in one unit of a time column: 1 for a clock, and for a column whose unit nobody states."""
    unit = options.time_unit or table.columns[time].unit
    factor = 1.0 if table.columns[time].kind == "clock" else seconds(canonical(unit) or unit)
    if factor is None:
        raise RecordingError(
            f"{table.path}: time column {table.names[time]!r} is in {unit!r}, which is not a unit of time; --time-unit "
            "states another one"
        )
    return factor


def _wanted(table: Table, time: int | None, unit: float, period: float, options: ReadOptions) -> slice:
    """The rows between two times after the first one."""
    if options.from_s is None and options.to_s is None and options.decimate is None:
        return slice(None)
    low, high = options.from_s or 0.0, math.inf if options.to_s is None else options.to_s
    if time is None:
        first, last = math.ceil(low / period - 1e-9), None if high == math.inf else int(high / period + 1e-9) + 1
        return slice(first, last, options.decimate)
    if low == 0.0 and high == math.inf:
        return slice(0, None, options.decimate)
    (times,) = table.read([time])
    since = (times - times[:1]) * unit
    inside = np.flatnonzero((since >= low) & (since <= high))
    if inside.size < 2:
        raise RecordingError(
            f"{table.path}: has {inside.size} rows between --from {low:g} and --to {high:g} seconds after its first "
            f"time; it lasts {np.nanmax(since):g} s"
        )
    return slice(int(inside[0]), int(inside[-1]) + 1, options.decimate)


def _refuse_other_clock(table: Table, time: int, times: Vector, period: float, options: ReadOptions) -> None:
    """Refuse a sampling period that contradicts a time column; a column that stands still is ignored."""
    known = times[np.abs(times) < ABSURD]
    by_clock = float(np.ptp(known)) * seconds_per_unit(table, time, options) if known.size else 0.0
    by_option = (times.size - 1) * period
    if by_clock > 0.0 and abs(by_clock - by_option) > CLOCK_TOLERANCE * by_clock:
        raise RecordingError(
            f"{table.path}: lasts {quantity(by_clock, 's')} by its time column {table.names[time]!r} and "
            f"{quantity(by_option, 's')} by --sample-time {period:g}; leave out --sample-time, or give --resample "
            "where the times are uneven, or --time none where that column is not a clock"
        )


def _question_period(label: str, period: float, guessed: bool) -> None:
    if period > LONGEST_PERIOD_S:
        raise RecordingError(
            f"{label} has one sample every {period:.6g} s{GUESS * guessed}; is a decimal mark lost, or is its unit "
            "another one? --time-unit states it, or confirms it"
        )


def _question_scale(label: str, role: str, unit: str, values: Vector) -> None:
    """Refuse magnitudes that no actuator has, with the question that confirms them."""
    if unit not in (*VOLTAGES, *LENGTHS):
        return
    factor, low, high = PREFIX[unit[:-1]], float(values.min()), float(values.max())
    reach, most = (max(-low, high), MOST_VOLTS) if unit in VOLTAGES else (high - low, MOST_METRES)
    if factor * reach > most:
        raise RecordingError(
            f"{label}, the {role}, reaches from {low:.6g} to {high:.6g} {unit}, more than {most:g} {unit[-1]}; is a "
            f"decimal mark lost, or is its unit another one? --{'input' if role == 'input' else 'output'}-unit states "
            "it, or confirms it"
        )
