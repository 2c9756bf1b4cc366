"""A recording: what was fed to an actuator and what came out, sampled uniformly.

The file, of any format that :mod:`piezo_model.recordings.formats` knows, has columns for the input x_k and the output
y_k, and for the time t_k = t_0 + k T unless T is known otherwise. It is checked once, when it is opened, and streamed
ever after: a recording of hours fits because nothing of it is kept but its ranges. Columns that the user does not name
are guessed (:mod:`piezo_model.recordings.roles`), and ``describe()`` says so; what is checked and how is in
:mod:`piezo_model.recordings.scan` and :mod:`piezo_model.recordings.sampling`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from piezo_model.recordings.chunks import RecordingError, check_sample_time, rechunk
from piezo_model.recordings.opening import open_table
from piezo_model.recordings.roles import choose_roles
from piezo_model.recordings.sampling import CHUNK, TIME_TOLERANCE
from piezo_model.recordings.scan import Scan, ValueCheck, scan
from piezo_model.recordings.tables import Column, ReadOptions
from piezo_model.structure import SMALLEST
from piezo_model.units import canonical, quantity, shown
from solvers.arrays import Matrix, Vector

HELD = 5_000_000
"""Samples up to which an identification keeps a recording in memory."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where signals come from."""

    name: str
    """Path of the file, or what arrays were called."""
    sample_time: float
    """Sampling period in seconds."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Column of the file by role."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Why a column was guessed, by role; not of those that the user named."""
    form: str = ""
    """How the file was understood, as a clause: "text, separated by tabs, header in row 3"."""


@dataclass(frozen=True, kw_only=True)
class Recording(Source):
    """Input and output of an actuator; made by :meth:`open` or :meth:`from_arrays`, which check it."""

    length: int
    """Samples."""
    x_range: tuple[float, float]
    """Smallest and largest input, in ``input_unit``."""
    y_range: tuple[float, float]
    """Smallest and largest output, in ``output_unit``."""
    input_unit: str = ""
    """Unit of the input ("V"), or "" where nothing says it."""
    output_unit: str = ""
    """Unit of the output ("um"), or "" where nothing says it."""
    time_resolution: float = 0.0
    """Rounding that shows in the times, in seconds."""
    _pieces: Callable[[], Iterable[Matrix]] = field(repr=False, compare=False)

    @classmethod
    def open(
        cls,
        path: str | Path,
        time: str | None = None,
        input: str | None = None,
        output: str | None = None,
        *,
        time_tolerance: float = TIME_TOLERANCE,
        sample_time: float | None = None,
        header_row: int | None = None,
        decimal: str | None = None,
        sheet: str | None = None,
        resample: float | None = None,
        input_unit: str | None = None,
        output_unit: str | None = None,
        hold: int = 0,
    ) -> Recording:
        """Open a file and check all of it, in one pass and in bounded memory.

        Parameters
        ----------
        path : str or Path
            Of any format; it is told by the content.
        time, input, output : str, optional
            Column names, paths such as ``group/channel``, or numbers counted from 1; guessed by default.
        time_tolerance : float
            Share of the sampling period by which an interval may differ from it, on top of the rounding of printed
            times.
        sample_time, header_row, decimal, sheet, resample, input_unit, output_unit
            What the file does not say, as in :class:`piezo_model.recordings.tables.ReadOptions`.
        hold : int
            Samples up to which the recording stays in memory; a longer one is read again whenever it is looked at.

        Raises
        ------
        RecordingError
            With one sentence that names file, column and row.

        Examples
        --------
        >>> import tempfile
        >>> from piezo_model.recordings import write_table
        >>> path = Path(tempfile.mkdtemp()) / "stage.csv"
        >>> write_table(path, {"time_s": [0.0, 0.005, 0.01], "voltage_V": [0, 1, 2], "displacement_um": [0, 8, 17]})
        >>> recording = Recording.open(path)
        >>> recording.sample_time, recording.length, recording.x_range, recording.output_unit
        (0.005, 3, (0.0, 2.0), 'um')
        """
        reading = ReadOptions(sample_time, header_row, decimal, sheet, resample, input_unit, output_unit)
        source, found, (x, y) = _read(
            path, {"time": time, "input": input, "output": output}, reading, time_tolerance, hold
        )
        for role, column, (low, high) in zip(("input", "output"), (x, y), found.ranges, strict=True):
            _refuse_constant(f"{path}: {role} column {column.name!r}", low, high, found.length)
        return cls(
            **source,
            length=found.length,
            x_range=found.ranges[0],
            y_range=found.ranges[1],
            input_unit=_unit(reading.input_unit, x),
            output_unit=_unit(reading.output_unit, y),
            time_resolution=found.time_resolution,
            _pieces=found.signals,
        )

    @classmethod
    def from_arrays(
        cls,
        x: ArrayLike,
        y: ArrayLike,
        sample_time: float,
        *,
        input_unit: str = "",
        output_unit: str = "",
        name: str = "arrays",
    ) -> Recording:
        """Make a recording of arrays in memory, which are copied.

        Parameters
        ----------
        x, y : array, shape (samples,)
            Input and output.
        sample_time : float
            Sampling period in seconds.

        Raises
        ------
        RecordingError
            Unequal shapes, values that are not finite, a constant input or output, or a senseless sampling period.
        """
        check_sample_time(f"{name}: ", sample_time)
        signals = {"input": np.asarray(x, dtype=np.float64), "output": np.asarray(y, dtype=np.float64)}
        shapes = [signal.shape for signal in signals.values()]
        if shapes[0] != shapes[1] or len(shapes[0]) != 1 or not shapes[0][0]:
            raise RecordingError(
                f"{name}: input and output must be one-dimensional, of one length and not empty, "
                f"not of shapes {shapes[0]} and {shapes[1]}"
            )
        ranges = []
        for role, signal in signals.items():
            check = ValueCheck(f"{name}: {role}", "sample {}".format)
            check.update(signal)
            check.finish()
            _refuse_constant(f"{name}: {role}", check.low, check.high, check.count)
            ranges.append((check.low, check.high))
        both = np.stack(list(signals.values()))
        return cls(
            name=name,
            sample_time=float(sample_time),
            length=both.shape[1],
            x_range=ranges[0],
            y_range=ranges[1],
            input_unit=input_unit,
            output_unit=output_unit,
            _pieces=partial(iter, (both,)),
        )

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to the last."""
        return (self.length - 1) * self.sample_time

    def chunks(self, size: int = CHUNK) -> Iterator[tuple[Vector, Vector]]:
        """Stream input and output as float64 arrays of ``size`` samples, the last ones shorter.

        Each call starts again at the first sample. The arrays are the caller's own.
        """
        count = 0
        for x, y in rechunk(self._pieces(), size):
            count += x.size
            yield x, y
        if count != self.length:
            raise RecordingError(f"{self.name}: has {count} data rows now and had {self.length} when it was opened")

    def arrays(self) -> tuple[Vector, Vector]:
        """Input and output, each of shape (length,), all in memory."""
        (both,) = self.chunks(self.length)
        return both

    def in_memory(self) -> Recording:
        """Return the same recording with its samples held in memory."""
        return replace(self, _pieces=partial(iter, (np.stack(self.arrays()),)))

    def head(self, samples: int) -> Recording:
        """Return the first samples, held in memory, with the ranges and units of the whole."""
        if self.length <= samples:
            return self.in_memory()
        return replace(self, length=samples, _pieces=partial(iter, (np.stack(next(self.chunks(samples))),)))

    def swapped(self) -> Recording:
        """Return the recording with input and output exchanged."""
        other = {"input": "output", "output": "input"}
        return replace(
            self,
            x_range=self.y_range,
            y_range=self.x_range,
            input_unit=self.output_unit,
            output_unit=self.input_unit,
            columns={other.get(role, role): name for role, name in self.columns.items()},
            reasons={other.get(role, role): why for role, why in self.reasons.items()},
            _pieces=partial(_turned, self._pieces),
        )

    def describe(self) -> str:
        """Say in two lines what was recorded, and which columns were guessed and why."""
        first = (
            f"{self.name}: {self.form + '; ' if self.form else ''}{self.length} samples over "
            f"{quantity(self.duration_s, 's')}, one every {quantity(self.sample_time, 's')}"
        )
        if "time" in self.columns:
            first += f" by {self.columns['time']!r}"
        if self.time_resolution > TIME_TOLERANCE * self.sample_time:
            first += f", rounded to {quantity(self.time_resolution, 's')}"
        second = ", ".join(
            _said(role, self.columns.get(role), unit, span)
            for role, unit, span in (
                ("input", self.input_unit, self.x_range),
                ("output", self.output_unit, self.y_range),
            )
        )
        return f"{first}\n{second}{_guessed(self.reasons)}"


@dataclass(frozen=True, kw_only=True)
class Reference(Source):
    """A signal to be followed; ``sample_time, values, unit = reference`` unpacks it."""

    values: Vector
    """The signal, shape (samples,)."""
    unit: str
    """Unit of the values, or "" where nothing says it."""

    def __iter__(self) -> Iterator[Any]:
        """Sampling period, values and unit."""
        return iter((self.sample_time, self.values, self.unit))

    def describe(self) -> str:
        """Say in a sentence what was read and which columns were guessed."""
        return (
            f"{self.name}: {self.form}; {self.values.size} samples, one every {quantity(self.sample_time, 's')}; "
            + _said(
                "reference", self.columns["reference"], self.unit, (float(self.values.min()), float(self.values.max()))
            )
            + _guessed(self.reasons)
        )


def read_reference(
    path: str | Path,
    time: str | None = None,
    column: str | None = None,
    *,
    role: str = "reference",
    time_tolerance: float = TIME_TOLERANCE,
    sample_time: float | None = None,
    header_row: int | None = None,
    decimal: str | None = None,
    sheet: str | None = None,
    resample: float | None = None,
    input_unit: str | None = None,
    output_unit: str | None = None,
) -> Reference:
    """Read a file of one signal to be followed, which may be constant, and the times if it has any.

    Parameters
    ----------
    path : str or Path
        Of any format, as for :meth:`Recording.open`.
    time, column : str, optional
        Column names; guessed by default.
    role : "reference" or "input"
        What the signal is to be recognised as.
    time_tolerance, sample_time, header_row, decimal, sheet, resample, input_unit, output_unit
        As for :meth:`Recording.open`.

    Raises
    ------
    RecordingError
        With one sentence that names file, column and row.
    """
    reading = ReadOptions(sample_time, header_row, decimal, sheet, resample, input_unit, output_unit)
    source, found, (signal,) = _read(path, {"time": time, role: column}, reading, time_tolerance, sys.maxsize)
    unit = _unit(reading.input_unit if role == "input" else reading.output_unit, signal)
    return Reference(**source, values=next(rechunk(found.signals(), found.length))[0], unit=unit)


def _read(
    path: str | Path, named: Mapping[str, str | None], reading: ReadOptions, tolerance: float, hold: int
) -> tuple[dict[str, Any], Scan, list[Column]]:
    """Fields of a `Source`, the samples of a file and the columns of its signals."""
    table = open_table(path, reading)
    roles = choose_roles(table, named, reading.sample_time is not None)
    found = scan(table, roles, reading, tolerance, hold)
    columns = {role: table.columns[k] for role, k in roles.at.items()}
    source = {
        "name": str(path),
        "sample_time": found.sample_time,
        "columns": {role: column.name for role, column in columns.items()},
        "reasons": roles.reasons,
        "form": table.form + found.remark,
    }
    return source, found, [column for role, column in columns.items() if role != "time"]


def _turned(pieces: Callable[[], Iterable[Matrix]]) -> Iterator[Matrix]:
    return (piece[::-1] for piece in pieces())


def _unit(given: str | None, column: Column) -> str:
    return column.unit if given is None else canonical(given) or given.strip()


def _refuse_constant(label: str, low: float, high: float, count: int) -> None:
    if low == high:
        raise RecordingError(f"{label} is constant, all {count} values are {low:g}")
    if high - low < 2.0 * SMALLEST:
        raise RecordingError(f"{label}: the range, {high - low:g}, is too small")


def _said(role: str, column: str | None, unit: str, span: tuple[float, float]) -> str:
    low, high = (f"{value:.4g}" if unit else quantity(value, "") for value in span)
    return f"{role}{f' {column!r}' if column else ''} from {low} to {high} {shown(unit) if unit else '(unit unknown)'}"


def _guessed(reasons: Mapping[str, str]) -> str:
    roles = {why: ", ".join(role for role in reasons if reasons[role] == why) for why in reasons.values()}
    said = "; ".join(f"{some} {why}" for why, some in roles.items())
    return f"; guessed: {said} (otherwise {', '.join(f'--{role}' for role in reasons)})" if reasons else ""
