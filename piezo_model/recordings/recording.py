"""A recording: input and output of an actuator, sampled uniformly, as two arrays.

The file, in any format of :mod:`piezo_model.recordings.formats`, has columns for the input x_k and the output y_k, and
for the time t_k = t_0 + k T unless T is known. It is read and checked once, when it is opened. Columns that the user
does not name are guessed (:mod:`piezo_model.recordings.roles`), and ``describe()`` reports the guesses; the checks are
in :mod:`piezo_model.recordings.opening`, and each repair is one of ``remarks``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.recordings.array_table import Arrays, table_of
from piezo_model.recordings.bad_values import MOST_MISSING, bad_value, unknown
from piezo_model.recordings.opening import GUESS, joined, open_table, read_signals
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.rows import Rows
from piezo_model.recordings.table import RecordingError, check_sample_time
from piezo_model.structure import SMALLEST
from piezo_model.units import conversion, quantity, shown
from solvers.arrays import Mask, Vector, read_only


@dataclass(frozen=True, kw_only=True)
class Source:
    """Origin of signals: a file or arrays."""

    name: str
    """Path of the file, or the name given to arrays."""
    sample_time: float
    """Sampling period in seconds."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Column of the file by role."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Reason of each guess by role; not for columns that the user named."""
    form: str = ""
    """Format and dialect of the file, as a clause: "text, separated by tabs, header in row 3"."""
    remarks: tuple[str, ...] = ()
    """What was dropped, interpolated or reordered, each as a clause."""
    guessed_seconds: bool = False
    """True if neither file nor user states the unit of the times."""
    units: str = ""
    """A sentence about what :meth:`in_units` has converted, or kept because a unit is unknown."""

    @property
    def notes(self) -> tuple[str, ...]:
        """The remarks, for reports, and one if seconds are assumed."""
        return self.remarks + ("seconds are assumed, since no unit of the times is stated",) * self.guessed_seconds

    def _describe_signal(self, role: str, unit: str, span: tuple[float, float]) -> str:
        column = f" {self.columns[role]!r}" if role in self.columns else ""
        low, high = (f"{value:.4g}" if unit else quantity(value, "") for value in span)
        return f"{role}{column} from {low} to {high} {shown(unit) if unit else '(unit unknown)'}"

    def _conversions(self, pairs: Mapping[str, tuple[str, str]]) -> tuple[tuple[float, ...], str]:
        """Factors by role, from the first unit to the second, and the new value of ``units``."""
        gains, clauses = zip(*(conversion(self.name, role, *pair) for role, pair in pairs.items()), strict=True)
        sentence = " and ".join(filter(None, clauses))
        return gains, f"{self.name}: {sentence}." if sentence else self.units

    def _describe_period(self) -> str:
        return f"one every {quantity(self.sample_time, 's')}{GUESS * self.guessed_seconds}"

    def _describe_guesses(self) -> str:
        if not self.reasons:
            return ""
        roles = {
            why: ", ".join(role for role in self.reasons if self.reasons[role] == why) for why in self.reasons.values()
        }
        guesses = "; ".join(f"{names} {why}" for why, names in roles.items())
        return f"; guessed: {guesses} (override with {', '.join(f'--{role}' for role in self.reasons)})"


@dataclass(frozen=True, kw_only=True)
class Recording(Source):
    """Input and output of an actuator; made by :meth:`open` or :meth:`from_arrays`, which check it."""

    x: Vector = field(repr=False, compare=False)
    """Input, shape (samples,), in ``input_unit``; read-only."""
    y: Vector = field(repr=False, compare=False)
    """Output, shape (samples,), in ``output_unit``, interpolated where it is missing; read-only."""
    uncounted: Mask = field(repr=False, compare=False)
    """Mask of samples that move the operators but are not counted, since their output is missing, shape (samples,);
    read-only."""
    starts: tuple[int, ...] = (0,)
    """First sample of each part, before which the states of the operators are unknown."""
    x_range: tuple[float, float]
    """Smallest and largest input, in ``input_unit``."""
    y_range: tuple[float, float]
    """Smallest and largest output, in ``output_unit``."""
    input_unit: str = ""
    """Unit of the input ("V"), or "" if unknown."""
    output_unit: str = ""
    """Unit of the output ("um"), or "" if unknown."""
    recordings: tuple[Recording, ...] = field(default=(), repr=False, compare=False)
    """The recordings of one stage that this one consists of, one after another, each with its own sampling period."""
    weights: tuple[float, ...] = (1.0,)
    """Weight of each recording in a mean over all samples."""

    @classmethod
    def open(
        cls,
        path: str | Path | None = None,
        time: str | None = None,
        input: str | None = None,
        output: str | None = None,
        **reading: Any,
    ) -> Self:
        """Read a file and check all of it.

        Parameters
        ----------
        path : str or Path, optional
            Of any format; the content determines it. Without it, ``input`` and ``output`` name two files, as ``FILE``
            or ``FILE:COLUMN``, whose rows have the same times.
        time, input, output : str, optional
            Column names, parts of them that no other column has, paths such as ``group/channel``, or numbers counted
            from 1; guessed by default.
        **reading
            As in :class:`piezo_model.recordings.options.ReadOptions`.

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
        options = ReadOptions(**reading)
        if path is None:
            if input is None or output is None:
                raise RecordingError("a recording in two files needs --input FILE and --output FILE")
            table, roles, reasons = joined(input, output, time, options)
            return replace(cls._of(*read_signals(table, roles, options)), reasons=reasons)
        named = {"time": time, "input": input, "output": output}
        return cls._of(*read_signals(open_table(path, named, options), named, options))

    @classmethod
    def of(
        cls,
        frame: Mapping[str, ArrayLike],
        time: str | None = None,
        input: str | None = None,
        output: str | None = None,
        *,
        name: str = "frame",
        **reading: Any,
    ) -> Self:
        """Check and repair named arrays, for a file that you read yourself, as :meth:`open` does the columns of a file.

        Parameters
        ----------
        frame : mapping of str to array, shape (samples,), or pandas.DataFrame
            Numbers, or times as datetime64 or timedelta64; other columns are left out.
        time, input, output, **reading
            As for :meth:`open`.
        name : str
            Name in errors and descriptions.

        Raises
        ------
        RecordingError
            With one sentence that names column and row.

        Examples
        --------
        >>> volts = np.array([0.0, 1.0, 2.0, 1.5])
        >>> recording = Recording.of({"t (ms)": [0, 5, 10, 15], "drive (V)": volts, "stroke (um)": 8 * volts})
        >>> recording.sample_time, recording.columns["output"], recording.y_range
        (0.005, 'stroke (um)', (0.0, 16.0))
        """
        arrays = Arrays("arrays", {str(column): np.asarray(frame[column]) for column in frame}, nested=False)
        named = {"time": time, "input": input, "output": output}
        return cls._of(*read_signals(table_of(name, arrays), named, ReadOptions(**reading)))

    @classmethod
    def _of(cls, about: Mapping[str, Any], rows: Rows, units: Sequence[str]) -> Self:
        for role, label, values in zip(("input", "output"), rows.labels, rows.signals, strict=True):
            low, high = (values.min(), values.max()) if values.size else (0.0, 0.0)
            if high - low < 2.0 * SMALLEST:
                raise RecordingError(
                    f"{rows.path}: {' '.join(dict.fromkeys((role, label)))} is constant, all {values.size} values are "
                    f"{low:g}" + f" to {high:g}" * bool(high > low)
                )
        x, y = rows.signals
        for array in (x, y, rows.uncounted):
            array.flags.writeable = False
        return cls(
            **about,
            x=x,
            y=y,
            uncounted=rows.uncounted,
            starts=tuple(rows.starts),
            x_range=(float(x.min()), float(x.max())),
            y_range=(float(y.min()), float(y.max())),
            input_unit=units[0],
            output_unit=units[1],
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
    ) -> Self:
        """Make a recording from copies of arrays.

        Parameters
        ----------
        x, y : array, shape (samples,)
            Input and output; up to half of the outputs may be missing (NaN).
        sample_time : float
            Sampling period in seconds.

        Raises
        ------
        RecordingError
            Unequal shapes, other values that are not finite, a constant input or output, or an impossible sampling
            period.
        """
        check_sample_time(f"{name}: ", sample_time)
        with checks.refusing(RecordingError, f"{name}: "):
            signals = [np.copy(signal) for signal in checks.vectors(input=x, output=y)]
        rows = Rows(name, ["input", "output"], signals, "sample {}".format, np.arange(signals[0].size, dtype=float))
        missing = np.isnan(rows.signals[1])
        if missing.any() and np.count_nonzero(missing) <= MOST_MISSING * rows.length:
            rows.replace(1, missing)
        for label, signal in zip(rows.labels, rows.signals, strict=True):
            if unknown(signal).any():
                raise bad_value(rows, label, signal)
        return cls._of({"name": name, "sample_time": float(sample_time)}, rows, (input_unit, output_unit))

    @property
    def length(self) -> int:
        """Number of samples."""
        return self.x.size

    @property
    def counted_y(self) -> Vector:
        """Output, shape (samples,), with NaN where it is not counted, as :class:`piezo_model.DataBasis` takes it."""
        return np.where(self.uncounted, np.nan, self.y)

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last of the longest recording, in seconds."""
        return max((recording.length - 1) * recording.sample_time for recording in self.recordings or (self,))

    def digest(self) -> str:
        """SHA-256 of the sampling period in nine digits, the starts of the parts, and the samples, each as input and
        output in float64 (little-endian) in their units; it does not depend on the file's format.

        Examples
        --------
        >>> Recording.from_arrays([0.0, 1.0], [0.0, 2.0], 1e-3).digest()[:8]
        '2375b46a'
        """
        samples = np.column_stack([self.x, self.counted_y]).astype("<f8")
        return hashlib.sha256(f"{self.sample_time:.9g} {self.starts}".encode() + samples.tobytes()).hexdigest()

    def part(self, samples: slice) -> Self:
        """Return consecutive samples, with the ranges and units of the whole recording.

        Examples
        --------
        >>> recording = Recording.from_arrays([0.0, 1.0, 2.0], [0.0, 2.0, 5.0], 1e-3)
        >>> recording.part(slice(1, None)).x.tolist()
        [1.0, 2.0]
        """
        first, last, _ = samples.indices(self.length)
        return replace(
            self,
            x=self.x[first:last],
            y=self.y[first:last],
            uncounted=self.uncounted[first:last],
            starts=(0, *(start - first for start in self.starts if first < start < last)),
        )

    def head(self, samples: int) -> Self:
        """Return the first samples, with the ranges and units of the whole recording."""
        return self.part(slice(samples))

    @property
    def parts(self) -> list[slice]:
        """The samples of each part."""
        return [slice(*ends) for ends in pairwise((*self.starts, self.length))]

    @property
    def time(self) -> Vector:
        """Time since the middle of each recording, shape (samples,), from −1 to 1 over the longest one."""
        longest, recordings = self.duration_s or 1.0, self.recordings or (self,)
        return np.concatenate(
            [recording.duration_s / longest * np.linspace(-1.0, 1.0, recording.length) for recording in recordings]
        )

    @property
    def owners(self) -> list[int]:
        """Number of the recording to which each part belongs, 0 for a single recording."""
        return [i for i, recording in enumerate(self.recordings or (self,)) for _ in recording.starts]

    @property
    def part_weights(self) -> list[float]:
        """Weight of each part in a mean over the samples."""
        return [self.weights[i] for i in self.owners]

    @property
    def periods(self) -> list[float]:
        """Sampling period of each part in s."""
        return [recording.sample_time for recording in self.recordings or (self,) for _ in recording.starts]

    def spread(self, of_parts: Sequence[float]) -> Vector:
        """Values of the parts, repeated for each of their samples, shape (samples,)."""
        return np.repeat(of_parts, np.diff((*self.starts, self.length)))

    def in_units(self, input_unit: str, output_unit: str) -> Self:
        """Return the recording in other units; if one of two units is unknown, the values are kept.

        Raises
        ------
        UnitError
            The recording is in units that measure something else, such as nm instead of V.

        Examples
        --------
        >>> recording = Recording.from_arrays([0.0, 1500.0], [0.0, 8.0], 1e-3, input_unit="mV", output_unit="um")
        >>> converted = recording.in_units("V", "um")
        >>> converted.x_range, converted.input_unit, converted.units
        ((0.0, 1.5), 'V', 'arrays: the input is converted from mV to V.')
        """
        (gain_x, gain_y), units = self._conversions(
            {"input": (self.input_unit, input_unit), "output": (self.output_unit, output_unit)}
        )
        return replace(
            self,
            x_range=(gain_x * self.x_range[0], gain_x * self.x_range[1]),
            y_range=(gain_y * self.y_range[0], gain_y * self.y_range[1]),
            input_unit=input_unit or self.input_unit,
            output_unit=output_unit or self.output_unit,
            units=units,
            x=self.x if gain_x == 1.0 else read_only(gain_x * self.x),
            y=self.y if gain_y == 1.0 else read_only(gain_y * self.y),
        )

    def describe(self) -> str:
        """Describe the samples and the guessed columns in two lines, and each remark in one."""
        gaps = int(np.count_nonzero(self.uncounted))
        clock = f" by {self.columns['time']!r}" if "time" in self.columns else ""
        first = (
            f"{self.name}: {self.form + '; ' if self.form else ''}{self.length} samples over "
            f"{quantity(self.duration_s, 's')}, {self._describe_period()}"
            f"{clock}{f'; {gaps} of them not counted' * bool(gaps)}"
        )
        input = self._describe_signal("input", self.input_unit, self.x_range)
        second = f"{input}, {self._describe_signal('output', self.output_unit, self.y_range)}{self._describe_guesses()}"
        return "\n".join((first, second, *(f"Note: {remark}." for remark in self.remarks)))


@dataclass(frozen=True, kw_only=True)
class Reference(Source):
    """A signal to follow; ``sample_time, values, unit = reference`` unpacks it."""

    values: Vector
    """The signal, shape (samples,)."""
    unit: str
    """Unit of the values, or "" if unknown."""

    def __iter__(self) -> Iterator[Any]:
        """Sampling period, values and unit."""
        return iter((self.sample_time, self.values, self.unit))

    def suited(self, unit: str, role: str = "reference") -> Self:
        """Return the signal in the unit of a model or a stage; UnitError for a unit that measures something else."""
        (gain,), units = self._conversions({role: (self.unit, unit)})
        return replace(self, values=gain * self.values, unit=unit or self.unit, units=units)

    def describe(self, role: str = "reference") -> str:
        """Describe the samples and the guessed columns in a sentence."""
        signal = self._describe_signal(role, self.unit, (float(self.values.min()), float(self.values.max())))
        return (
            f"{self.name}: {self.form}; {self.values.size} samples, {self._describe_period()}; "
            f"{signal}{self._describe_guesses()}" + "".join(f"; {remark}" for remark in self.remarks)
        )


def read_reference(
    path: str | Path,
    time: str | None = None,
    column: str | None = None,
    *,
    role: str = "reference",
    **reading: Any,
) -> Reference:
    """Read a signal to follow, which may be constant, and its times if the file has any.

    Parameters
    ----------
    path : str or Path
        Of any format, as for :meth:`Recording.open`.
    time, column : str, optional
        Column names; guessed by default.
    role : "reference" or "input"
        Role by which the signal is found.
    **reading
        As for :meth:`Recording.open`.

    Raises
    ------
    RecordingError
        With one sentence that names file, column and row.
    """
    options, named = ReadOptions(**reading), {"time": time, role: column}
    about, rows, (unit,) = read_signals(open_table(path, named, options), named, options)
    return Reference(**about, values=rows.signals[0], unit=unit)
