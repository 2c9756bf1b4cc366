"""A recording: what was fed to an actuator and what came out, sampled uniformly.

The file (CSV or Parquet) has a time column t_k = t_0 + k T and named columns for the input x_k and the output y_k. It
is checked once, when it is opened, and streamed ever after: a recording of hours fits because nothing of it is kept but
its ranges. Columns that the user does not name are guessed from the header (:mod:`piezo_model.recordings.columns`), and
``describe()`` says so; what is checked and how is in :mod:`piezo_model.recordings.checks`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from piezo_model.recordings.checks import CHUNK, TIME_TOLERANCE, ValueCheck, scan
from piezo_model.recordings.columns import INPUT, OUTPUT, REFERENCE, TIME, choose, seconds_per_unit, split_unit
from piezo_model.recordings.pieces import Matrix, RecordingError, Vector, rechunk
from piezo_model.recordings.tables import open_table


@dataclass(frozen=True)
class Recording:
    """Input and output of an actuator; made by :meth:`open` or :meth:`from_arrays`, which check it."""

    name: str
    """Path of the file, or what arrays were called."""
    sample_time: float
    """Sampling period in seconds."""
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
    columns: Mapping[str, str] = field(default_factory=dict)
    """Column of the file by role: time, input, output."""
    guesses: Mapping[str, str] = field(default_factory=dict)
    """Those of ``columns`` that nobody named."""
    time_resolution: float = 0.0
    """Rounding that shows in the times, in seconds."""
    _pieces: Callable[[], Iterable[Matrix]] = field(repr=False, compare=False, default=tuple)

    @classmethod
    def open(cls, path: str | Path, time: str | None = None, input: str | None = None, output: str | None = None, *,
             time_tolerance: float = TIME_TOLERANCE) -> Recording:
        """Open a file and check all of it, in one pass and in bounded memory.

        Parameters
        ----------
        path : str or Path
            CSV (comma, semicolon or tab; decimal points; a header) or Parquet, told by the suffix.
        time, input, output : str, optional
            Column names; guessed from the header by default.
        time_tolerance : float
            Share of the sampling period by which an interval may differ from it, on top of the rounding of printed
            times.

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
        table = open_table(path)
        columns, guesses = choose(table, {TIME: time, INPUT: input, OUTPUT: output})
        signals = [columns["input"], columns["output"]]
        found = scan(table, columns["time"], signals, seconds_per_unit(table, columns["time"]), time_tolerance)
        for role, column, (low, high) in zip(("input", "output"), signals, found.ranges, strict=True):
            _refuse_constant(f"{table.path}: {role} column {column!r}", low, high, found.length)
        x_range, y_range = found.ranges
        input_unit, output_unit = (split_unit(column)[1] for column in signals)
        return cls(str(path), found.sample_time, found.length, x_range, y_range, input_unit, output_unit, columns,
                   guesses, found.time_resolution, partial(table.pieces, signals))

    @classmethod
    def from_arrays(cls, x: ArrayLike, y: ArrayLike, sample_time: float, *, input_unit: str = "", output_unit: str = "",
                    name: str = "arrays") -> Recording:
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
        if not (math.isfinite(sample_time) and sample_time > 0):
            raise RecordingError(f"{name}: the sampling period must be a positive number of seconds, not {sample_time}")
        signals = {"input": np.asarray(x, dtype=np.float64), "output": np.asarray(y, dtype=np.float64)}
        shapes = [signal.shape for signal in signals.values()]
        if shapes[0] != shapes[1] or len(shapes[0]) != 1 or not shapes[0][0]:
            raise RecordingError(f"{name}: input and output must be one-dimensional, of one length and not empty, "
                                 f"not of shapes {shapes[0]} and {shapes[1]}")
        ranges = []
        for role, signal in signals.items():
            check = ValueCheck(f"{name}: {role}", "sample {}".format)
            check.update(signal)
            check.finish()
            _refuse_constant(f"{name}: {role}", check.low, check.high, check.count)
            ranges.append((check.low, check.high))
        both = np.stack(list(signals.values()))
        return cls(name, float(sample_time), both.shape[1], ranges[0], ranges[1], input_unit, output_unit,
                   _pieces=partial(iter, (both,)))

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

    def require(self, samples: int) -> None:
        """Refuse a recording of fewer samples than, say, the order of a model needs."""
        if self.length < samples:
            raise RecordingError(f"{self.name}: has {self.length} samples, and {samples} are needed at least")

    def describe(self) -> str:
        """Say in a sentence what was recorded and which columns were guessed."""
        signals = [f"{role} {_named(self.columns.get(role), unit)} from {low:g} to {high:g}" for role, unit, (low, high)
                   in (("input", self.input_unit, self.x_range), ("output", self.output_unit, self.y_range))]
        said = (f"{self.name}: {self.length} samples over {self.duration_s:g} s, one every {self.sample_time:g} s; "
                + ", ".join(signals))
        if "time" in self.columns:
            said += f", time {_named(self.columns['time'], split_unit(self.columns['time'])[1] or 's')}"
        if self.time_resolution > TIME_TOLERANCE * self.sample_time:
            said += f" rounded to {self.time_resolution:g} s"
        return said + _guessed(self.guesses)


@dataclass(frozen=True)
class Reference:
    """A signal to be followed; ``sample_time, values, unit = reference`` unpacks it."""

    sample_time: float
    """Sampling period in seconds."""
    values: Vector
    """The signal, shape (samples,)."""
    unit: str
    """Unit of the values, or "" where nothing says it."""
    name: str
    """Path of the file."""
    columns: Mapping[str, str]
    """Column of the file by role: time, reference."""
    guesses: Mapping[str, str]
    """Those of ``columns`` that nobody named."""

    def __iter__(self) -> Iterator[Any]:
        """Sampling period, values and unit."""
        return iter((self.sample_time, self.values, self.unit))

    def describe(self) -> str:
        """Say in a sentence what was read and which columns were guessed."""
        return (f"{self.name}: {self.values.size} samples, one every {self.sample_time:g} s; reference "
                f"{_named(self.columns['reference'], self.unit)}" + _guessed(self.guesses))


def read_reference(path: str | Path, time: str | None = None, column: str | None = None, *,
                   time_tolerance: float = TIME_TOLERANCE) -> Reference:
    """Read a file of a time column and one signal to be followed, which may be constant.

    Parameters
    ----------
    path : str or Path
        CSV or Parquet, as for :meth:`Recording.open`.
    time, column : str, optional
        Column names; guessed from the header by default.
    time_tolerance : float
        As for :meth:`Recording.open`.

    Raises
    ------
    RecordingError
        With one sentence that names file, column and row.
    """
    table = open_table(path)
    columns, guesses = choose(table, {TIME: time, REFERENCE: column})
    found = scan(table, columns["time"], [columns["reference"]], seconds_per_unit(table, columns["time"]),
                 time_tolerance)
    values = next(rechunk(table.pieces([columns["reference"]]), found.length))[0]
    return Reference(found.sample_time, values, split_unit(columns["reference"])[1], str(path), columns, guesses)


def _refuse_constant(label: str, low: float, high: float, count: int) -> None:
    if low == high:
        raise RecordingError(f"{label} is constant, all {count} values are {low:g}")


def _named(column: str | None, unit: str) -> str:
    return f"{column!r} ({unit or 'unit unknown'})" if column else f"({unit or 'unit unknown'})"


def _guessed(guesses: Mapping[str, str]) -> str:
    if not guesses:
        return ""
    return f"; guessed from the header: {', '.join(guesses)} (otherwise {', '.join(f'--{role}' for role in guesses)})"
