"""One recording in two files, as an oscilloscope writes its channels: the drive of one, the sensor of the other."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from piezo_model.recordings.opening import open_table, seconds_per_unit
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.roles import NO_CLOCK, choose_roles
from piezo_model.recordings.rows import is_near
from piezo_model.recordings.table import Column, RecordingError, Table
from piezo_model.units import canonical, seconds
from solvers.arrays import Vector


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
    first, times, x, drive, unit_s, reasons_x = _channel(input, time, options)
    second, others, y, sensor, _, reasons_y = _channel(output, time, options)
    path, repairs, where = f"{first.path} and {second.path}", (*first.repairs, *second.repairs), first.where
    if times is None or others is None:
        if x.size != y.size:
            raise RecordingError(f"{path}: have {x.size} and {y.size} rows, and no times by which they could be joined")
        times = others if times is None else times
    elif (
        times.size != others.size or np.abs(times - others).max() > options.time_tolerance * np.ptp(times) / times.size
    ):
        common = np.flatnonzero((times >= others[0]) & (times <= others[-1]))
        if common.size < 2:
            raise RecordingError(
                f"{path}: have no time in common, {times[0]:g} to {times[-1]:g} s and {others[0]:g} to {others[-1]:g} s"
            )
        near = is_near(times[common], others, float(np.median(np.diff(times))))
        y = np.where(near, np.interp(times[common], others, y), np.nan)
        times, x, where = times[common], x[common], lambda row: first.where(int(common[row]))
        repairs += (f"the output is interpolated at the {times.size} times of the input that both files have",)
    unit = options.time_unit or "s"
    arrays = [x, y] if times is None else [times / (seconds(canonical(unit) or unit) or 1.0), x, y]
    columns = [Column("time", unit_s)] * (len(arrays) - 2) + [
        replace(of, name=f"{table.path}/{of.name}", nested=True, rows=None)
        for table, of in ((first, drive), (second, sensor))
    ]
    roles = {
        "time": NO_CLOCK if times is None else "1",
        "input": str(len(arrays) - 1),
        "output": str(len(arrays)),
    }
    reasons = {
        "time" if key == "time" else role: why
        for role, of in (("input", reasons_x), ("output", reasons_y))
        for key, why in of.items()
    }
    return (
        Table(
            path,
            f"two files, the first {first.form}",
            tuple(columns),
            lambda at: [[arrays[k] for k in at]],
            where,
            repairs,
        ),
        roles,
        reasons,
    )


def _channel(
    name: str, time: str | None, options: ReadOptions
) -> tuple[Table, Vector | None, Vector, Column, str, Mapping[str, str]]:
    """Table, times in seconds (None where the file has none), values and their column, "s" or "" where seconds are a
    guess, and the reasons of the guesses."""
    path, column = split_name(name)
    named = {"time": time, "reference": column}
    table = open_table(path, named, options)
    roles = choose_roles(table, named, options.sample_time is not None)
    clock, k = roles.columns.get("time"), roles.columns["reference"]
    if clock is None:
        return (table, None, table.read([k])[0], table.columns[k], "", roles.reasons)
    times, values = table.read([clock, k])
    known, factor = ~np.isnan(times), seconds_per_unit(table, clock, options)
    unit = "s" if table.columns[clock].unit or table.columns[clock].kind == "clock" else ""
    return (table, times[known] * factor, values[known], table.columns[k], unit, roles.reasons)
