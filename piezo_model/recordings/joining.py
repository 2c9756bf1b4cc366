"""One recording in two files, as an oscilloscope writes its channels: the drive of one, the sensor of the other."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezo_model.recordings.opening import open_table, seconds_per_unit
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.roles import NO_CLOCK, choose_roles
from piezo_model.recordings.table import Column, RecordingError, Table
from piezo_model.units import canonical, seconds
from solvers.arrays import Vector


class Channel(NamedTuple):
    """One signal of a file."""

    table: Table
    times: Vector | None
    """In seconds; None where the file has none."""
    values: Vector
    column: Column
    unit: str
    """"s", or "" where seconds are a guess."""
    reasons: Mapping[str, str]
    """Of the guesses of its columns."""


def split_name(text: str) -> tuple[Path, str | None]:
    """File and column of ``FILE`` or ``FILE:COLUMN``."""
    file, _, column = text.rpartition(":")
    return (Path(file), column) if file and Path(file).is_file() else (Path(text), None)


def joined(
    input: str, output: str, time: str | None, options: ReadOptions
) -> tuple[Table, dict[str, str], dict[str, str]]:
    """A table of time, drive and sensor from two files, at the times of the first one that both have, by role the
    number of its column, and by role the reason of a guess.

    Raises
    ------
    RecordingError
        Columns that cannot be told, or files without times whose numbers of rows differ, or without a time in common.
    """
    drive, sensor = (_channel(name, time, options) for name in (input, output))
    first, second = drive.table, sensor.table
    path, repairs, where = f"{first.path} and {second.path}", (*first.repairs, *second.repairs), first.where
    x, y, times, others = drive.values, sensor.values, drive.times, sensor.times
    if times is None or others is None:
        if x.size != y.size:
            raise RecordingError(f"{path}: have {x.size} and {y.size} rows, and no times by which they could be joined")
        times = others if times is None else times
    elif not _agree(times, others, options.time_tolerance):
        common = np.flatnonzero((times >= others[0]) & (times <= others[-1]))
        if common.size < 2:
            raise RecordingError(
                f"{path}: have no time in common, {times[0]:g} to {times[-1]:g} s and {others[0]:g} to {others[-1]:g} s"
            )
        y = np.interp(times[common], others, y)
        times, x, where = times[common], x[common], lambda row: first.where(int(common[row]))
        repairs += (f"the output is interpolated at the {times.size} times of the input that both files have",)
    columns = [
        replace(drive.column, name=f"{first.path}/{drive.column.name}", nested=True, rows=None),
        replace(sensor.column, name=f"{second.path}/{sensor.column.name}", nested=True, rows=None),
    ]
    roles, arrays = {"time": NO_CLOCK, "input": "1", "output": "2"}, [x, y]
    if times is not None:
        unit = options.time_unit or "s"
        columns.insert(0, Column("time", drive.unit))
        arrays.insert(0, times / (seconds(canonical(unit) or unit) or 1.0))
        roles = {"time": "1", "input": "2", "output": "3"}
    found = {"time": drive.reasons.get("time"), "input": drive.reasons.get("reference")}
    reasons = {role: why for role, why in {**found, "output": sensor.reasons.get("reference")}.items() if why}
    form = f"two files, the first {first.form}"
    table = Table(path, form, tuple(columns), lambda at: [[arrays[k] for k in at]], where, repairs)
    return table, roles, reasons


def _channel(name: str, time: str | None, options: ReadOptions) -> Channel:
    path, column = split_name(name)
    table = open_table(path, options)
    roles = choose_roles(table, {"time": time, "reference": column}, options.sample_time is not None)
    clock, k = roles.columns.get("time"), roles.columns["reference"]
    if clock is None:
        return Channel(table, None, table.read([k])[0], table.columns[k], "", roles.reasons)
    times, values = table.read([clock, k])
    known, factor = ~np.isnan(times), seconds_per_unit(table, clock, options)
    unit = "s" if table.columns[clock].unit or table.columns[clock].kind == "clock" else ""
    return Channel(table, times[known] * factor, values[known], table.columns[k], unit, roles.reasons)


def _agree(times: Vector, others: Vector, tolerance: float) -> bool:
    """Whether two clocks tell the same times."""
    period = (times[-1] - times[0]) / max(times.size - 1, 1)
    return times.size == others.size and bool(np.abs(times - others).max() <= tolerance * period)
