"""From a file to even samples: its table, the roles of the columns, the selected rows, and their faults, which are
repaired and reported if that is safe, or refused with the row. Values that are implausible for their units are
questioned.

The repairs in order: unknown values (`bad_values`), repeated stamps and parts (`rows`), the clock (`clock`), isolated
bad samples (`bad_values`), and an even clock by linear interpolation within each part,

    y(t_0 + k T) = y_i + (y_{i+1} − y_i) (t_0 + k T − t_i) / (t_{i+1} − t_i),   t_i ≤ t_0 + k T ≤ t_{i+1}.
"""

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezo_model.recordings.bad_values import (
    discount_held_outputs,
    interpolate_unknown,
    replace_bad_samples,
)
from piezo_model.recordings.clock import sampling
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.roles import NO_CLOCK, Roles, choose_roles
from piezo_model.recordings.rows import (
    LEAST_ROWS,
    Rows,
    begin_parts,
    drop_repeats,
    refuse_sorted,
    run_starts,
)
from piezo_model.recordings.table import FEW_ROWS, RecordingError, Table
from piezo_model.units import LENGTHS, PREFIXES, VOLTAGES, canonical, seconds
from solvers.arrays import Index, Vector

MOST_NAMED = 8
"""Most columns that are named in a list of tables."""
CLOCK_TOLERANCE = 0.01
"""Largest relative difference between the sampling periods by a time column and by the user."""
MOST_VOLTS, MOST_METRES, LONGEST_PERIOD_S = 1e4, 1.0, 60.0
"""Largest voltage, travel and sampling period that need no confirmation."""
DAYS, SHORTEST_IN_DAYS, MOST_SECONDS = (3e4, 8e5), 2e-5, 1e10
"""First times that may be days, as of Excel and MATLAB, with shorter periods than these; times since 1970 that are
larger are no seconds."""
GUESS = " (seconds assumed; override with --time-unit)"
NEAR = 0.75
"""Largest distance of an interpolated value from a measured one, in sampling periods, at which it is counted."""
MOST_SAMPLES = 1_000_000_000
MOST_MULTIPLIED, ON_A_ROW = 10, 1e-6
"""Largest ratio of samples to rows that needs no confirmation; distance from a row, in rows, of a sample that is on
it."""
PREFIX = {"p": 1e-12, **PREFIXES}


def open_table(path: str | Path, named: Mapping[str, str | None], options: ReadOptions) -> Table:
    """The table of a file that the user has chosen, or the only one with the columns of a recording.

    Raises
    ------
    RecordingError
        Several of the tables, or none, can be the recording; see also
        :func:`piezo_model.recordings.formats.open_tables`.
    """
    from piezo_model.recordings import formats  # imports pyarrow

    tables = formats.open_tables(path, options)
    listed = [
        f"{k} {table.title!r} ({', '.join(table.names[:MOST_NAMED])}; {table.rows} rows)"
        for k, table in enumerate(tables, start=1)
    ]
    if options.table is not None:
        query, titles = str(options.table).casefold(), [table.title.casefold() for table in tables]
        same = [k for k, title in enumerate(titles) if query in (title, str(k + 1))]
        fits = same or [k for k, title in enumerate(titles) if query in title]
        question = f"has {len(fits) or 'no'} tables {options.table!r}"
    elif len(tables) > 1:
        fits = []
        for k, table in enumerate(tables):
            with suppress(RecordingError):
                choose_roles(table, named, options.sample_time is not None)
                fits += [k] * (table.rows > FEW_ROWS)
        question = f"has {len(tables)} tables, and the columns of {len(fits) or 'none'} look like a recording"
    else:
        return tables[0]
    if len(fits) != 1:
        raise RecordingError(f"{path}: {question}; --table takes a number or a name: {'; '.join(listed)}")
    chosen, about = tables[fits[0]], listed.pop(fits[0])
    return replace(chosen, form=f"{chosen.form}, table {about}, without {'; '.join(listed)}") if listed else chosen


def read_signals(
    table: Table, named: Mapping[str, str | None], options: ReadOptions
) -> tuple[dict[str, Any], Rows, list[str]]:
    """Fields of a `Source`, even samples of the signals, and their units ("" if unknown).

    Parameters
    ----------
    table : Table
        An opened file.
    named : mapping of str to str or None
        By role the column that the user named, or None to guess it; the time comes first.
    options : ReadOptions

    Raises
    ------
    RecordingError
        Roles that cannot be determined, rows that cannot be read or repaired, or values that must be confirmed.
    """
    roles = choose_roles(table, named, options.sample_time is not None)
    time = roles.columns.get("time")
    signals = {role: k for role, k in roles.columns.items() if role != "time"}
    if time is None and options.resample is not None:
        raise RecordingError(f"{table.path}: --resample needs a time column, and there is none; name it with --time")
    unit = 1.0 if time is None else seconds_per_unit(table, time, options)
    stated, *others = dict.fromkeys(table.columns[k].sample_time for k in signals.values())
    if others and time is None and options.sample_time is None:
        raise RecordingError(
            f"{table.path}: {' and '.join(repr(table.names[k]) for k in signals.values())} are sampled every "
            f"{stated:g} and {others[0]:g} s; resample one of them"
        )
    period = options.sample_time or stated or 1.0
    starts = [start for k in signals.values() if (start := table.columns[k].start) is not None]
    if starts and max(starts) - min(starts) > (stated or 0.0) / 2.0:
        raise RecordingError(
            f"{table.path}: {' and '.join(repr(table.names[k]) for k in signals.values())} start "
            f"{max(starts) - min(starts):.3g} s apart by the times of their waveforms; a row needs samples of one time"
        )
    selected, kept = _selected_rows(table, time, unit, period, options)
    columns = dict(zip(roles.columns, table.read([*roles.columns.values()], selected), strict=True))
    first, step = selected.start or 0, selected.step or 1
    rows = Rows(
        table.path,
        [f"column {table.names[k]!r}" for k in signals.values()],
        [columns[role] for role in signals],
        lambda row: table.where(first + step * row),
        np.arange(len(next(iter(columns.values()))), dtype=float) if time is None else columns["time"],
        "" if time is None else f"time column {table.names[time]!r}",
        unit,
        repairs=[*table.repairs],
    )
    if kept is not None:
        rows.select(kept)
        rows.starts = [0, *(np.flatnonzero(np.diff(kept) > 1) + 1).tolist()]
    if selected != slice(None):
        rows.remarks.append(f"read from {rows.where(0)} on" + f", one row in {step}" * (step > 1))
    del columns
    sample_time = _sampled(rows, period * step, options)
    if time is not None and options.sample_time and abs(sample_time - period * step) > CLOCK_TOLERANCE * sample_time:
        raise rows.refusal(
            f"has one sample every {sample_time:.6g} s, and --sample-time or --sample-rate says "
            f"{period * step:.6g} s; omit it, or give --time none if that column is not a clock"
        )
    is_number = time is not None and table.columns[time].kind == "number"
    guessed = is_number and not (time is None or table.columns[time].unit or options.time_unit)
    is_stated = time is None and options.sample_time is None and stated is not None
    dated = guessed and (
        abs(rows.times[0]) > MOST_SECONDS or (DAYS[0] < rows.times[0] < DAYS[1] and sample_time < SHORTEST_IN_DAYS)
    )
    if dated or (
        sample_time > LONGEST_PERIOD_S
        and options.resample is None
        and (is_stated or (is_number and options.time_unit is None))
    ):
        whose, confirmed_by = ("its header", "--sample-time") if is_stated else (rows.time_label, "--time-unit")
        raise RecordingError(
            f"{table.path}: {whose} has one sample every {sample_time:.6g} s{GUESS * guessed}; is a decimal mark "
            f"missing, or the unit wrong? {confirmed_by} states or confirms it"
        )
    about = {
        "name": str(table.path),
        "sample_time": sample_time,
        "columns": {role: table.names[k] for role, k in roles.columns.items()},
        "reasons": roles.reasons,
        "form": f"{table.form}, which states the sampling period" if is_stated else table.form,
        "remarks": (*rows.remarks, *rows.repairs),
        "guessed_seconds": guessed,
    }
    return about, rows, [_unit(table, *of, options) for of in zip(signals, signals.values(), rows.signals, strict=True)]


def _sampled(rows: Rows, period: float, options: ReadOptions) -> float:
    """Turn rows into even samples, in place; returns their sampling period, which is known for rows without times."""
    interpolate_unknown(rows)
    drop_repeats(rows)
    if rows.length < 2:
        raise RecordingError(
            f"{rows.path}: has {'1 data row' if rows.length else 'no data rows'}, and a recording needs two"
        )
    begin_parts(rows, even=options.resample is None)
    sample_time = sampling(rows, options.time_tolerance, options.resample is None) if rows.time_label else period
    if rows.length >= LEAST_ROWS:
        if len(rows.signals) > 1:
            refuse_sorted(rows)
            discount_held_outputs(rows)
        replace_bad_samples(rows)
    if options.strict and rows.repairs:
        raise RecordingError(f"{rows.path}: {rows.repairs[0]}; without --strict it is repaired")
    return sample_time if options.resample is None else _resampled(rows, options.resample, options)


def _resampled(rows: Rows, period: float, options: ReadOptions) -> float:
    """Interpolate to an even clock; a sample counts if the rows on both sides do."""
    times, count = rows.times, rows.length
    duration = float(times[-1] - times[0]) * rows.unit
    length = int(duration / period + 1e-9) + 1
    if not 2 <= length <= (MOST_SAMPLES if options.time_unit else MOST_MULTIPLIED * count):
        raise RecordingError(
            f"{rows.path}: --resample {period:g} makes {length} samples of {count} rows over {duration:g} s; are the "
            "times in another unit? --time-unit states or confirms it"
        )
    grid = times[0] + period / rows.unit * np.arange(length)
    at = np.interp(grid, times, np.arange(count))
    grid = grid[(np.abs(at - np.round(at)) < ON_A_ROW) | ~np.isin(np.ceil(at), rows.starts[1:])]  # not between parts
    rows.signals = [np.interp(grid, times, signal) for signal in rows.signals]
    after = np.searchsorted(times, grid).clip(1, count - 1)
    distance = np.minimum(np.abs(grid - times[after - 1]), np.abs(times[after] - grid))
    near = distance <= NEAR * max(period / rows.unit, float(np.median(np.diff(times))))
    rows.uncounted = (np.interp(grid, times, rows.uncounted) > 0.0) | ~near
    rows.starts = np.unique(np.searchsorted(grid, times[rows.starts])).tolist()
    rows.remarks.append(
        f"interpolated from {count} rows at the times of the file"
        + f"; {np.count_nonzero(~near)} of {near.size} samples are far from a row, and not counted" * (not near.all())
    )
    return period


def split_name(text: str) -> tuple[Path, str | None]:
    """File and column of ``FILE`` or ``FILE:COLUMN``."""
    file, _, column = str(text).rpartition(":")
    return (Path(file), column) if file and Path(file).is_file() else (Path(str(text)), None)


def joined(
    input: str, output: str, time: str | None, options: ReadOptions
) -> tuple[Table, dict[str, str], dict[str, str]]:
    """A table of time, drive and sensor from two files of equal times, as an oscilloscope writes its channels; and by
    role the number of its column, and the reason of a guess.

    Raises
    ------
    RecordingError
        Columns that cannot be determined, or different numbers of rows or times.
    """
    (first, (*times, x)), (second, (*times_y, y)) = (_channel(name, time, options) for name in (input, output))
    table, path = first.table, f"{first.table.path} and {second.table.path}"
    clocks = [
        clock * seconds_per_unit(of.table, of.columns["time"], options)
        for of, read in ((first, times), (second, times_y))
        for clock in read
    ]
    apart = np.ptp(clocks, axis=0).max() if clocks and x.size > 1 and x.size == y.size else 0.0
    if x.size != y.size or (clocks and apart > options.time_tolerance * np.ptp(clocks) / x.size):
        raise RecordingError(
            f"{path}: have {x.size} and {y.size} rows, or different times; two files are one recording if each row of "
            "one was sampled with that of the other"
        )
    sources = [*((first, k) for k in first.columns.values()), (second, second.columns["reference"])]
    columns = [
        replace(column, name=f"{of.table.path}/{column.name}", nested=True, rows=None)
        for of, column in ((of, of.table.columns[k]) for of, k in sources)
    ]
    arrays = [*times, x, y]
    named = {"time": "1" if times else NO_CLOCK, "input": str(len(arrays) - 1), "output": str(len(arrays))}
    reasons = {
        "time" if key == "time" else role: why
        for role, of in (("input", first), ("output", second))
        for key, why in of.reasons.items()
    }
    return (
        Table(
            path,
            f"two files, the first {table.form}",
            tuple(columns),
            lambda at: [[arrays[k] for k in at]],
            table.where,
            (*table.repairs, *second.table.repairs),
        ),
        named,
        reasons,
    )


def _channel(name: str, time: str | None, options: ReadOptions) -> tuple[Roles, list[Vector]]:
    """Roles, and the times, if the file has any, and values."""
    path, column = split_name(name)
    named = {"time": time, "reference": column}
    table = open_table(path, named, options)
    roles = choose_roles(table, named, options.sample_time is not None)
    return roles, table.read([*roles.columns.values()])


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


def _selected_rows(
    table: Table, time: int | None, unit: float, period: float, options: ReadOptions
) -> tuple[slice, Index | None]:
    """The rows to read, and which of them are between two times since the start of their part; None for all."""
    low, high = options.from_s or 0.0, math.inf if options.to_s is None else options.to_s
    if time is None:
        first, last = math.ceil(low / period - 1e-9), None if high == math.inf else int(high / period + 1e-9) + 1
        return slice(first or None, last, options.decimate), None
    if low == 0.0 and high == math.inf:
        return slice(None, None, options.decimate), None
    (times,) = table.read([time])
    starts = run_starts(times)
    since = (times - np.repeat(np.fmin.reduceat(times, starts), np.diff([*starts, times.size]))) * unit
    inside = (since >= low) & (since <= high)
    rows = np.flatnonzero(inside)
    if rows.size < 2:
        raise RecordingError(
            f"{table.path}: has {rows.size} rows between --from {low:g} and --to {high:g} (seconds after its first "
            f"time); its times rise for {np.nanmax(since):g} s"
        )
    selected = slice(int(rows[0]), int(rows[-1]) + 1, options.decimate)
    return selected, np.flatnonzero(inside[selected])


def _unit(table: Table, role: str, k: int, values: Vector, options: ReadOptions) -> str:
    """The unit of a signal; implausible magnitudes are refused with a question, and the option that confirms them."""
    stated = options.input_unit if role == "input" else options.output_unit
    if stated is not None:
        return canonical(stated) or stated.strip()
    unit = table.columns[k].unit
    if unit in (*VOLTAGES, *LENGTHS):
        low, high = float(values.min()), float(values.max())
        reach, most = (max(-low, high), MOST_VOLTS) if unit in VOLTAGES else (high - low, MOST_METRES)
        if PREFIX[unit[:-1]] * reach > most:
            raise RecordingError(
                f"{table.path}: column {table.names[k]!r}, the {role}, reaches from {low:.6g} to {high:.6g} {unit}, "
                f"more than {most:g} {unit[-1]}; is a decimal mark missing, or the unit wrong? "
                f"--{'input' if role == 'input' else 'output'}-unit states or confirms it"
            )
    return unit
