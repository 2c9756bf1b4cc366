"""Problems of a user's recording, for models of several orders over several windows.

The last fifth of the recording is unseen data for validation. The operators follow the rest from its first sample on,
with the initial states and the sign that `piezo_model.identification.start` finds; samples count from the end of a
switch-on transient or the start of the window, whichever is later. A recording has an unknown constant, so every model
has an offset, a variable without bounds.

The set also has a model: the one that `identify` makes of the whole recording. Its error is that of the model that
`identify` makes of the fitted part, by ``HysteresisCreepModel.validate`` on the unseen part; all problems have the
creep rates of the latter, and the last ones its orders, so that the race's times apply to that size.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from piezo_model import DataBasis, HysteresisCreepModel, Recording, identify
from piezo_model.identification.creep import candidate_rates
from piezo_model.identification.error_model import IdentificationError, ProgramSolver, one_thread
from piezo_model.identification.start import InitialFit, prepare, structure_of
from piezo_model.recordings.options import ReadOptions

ORDERS = ((5, 3), (2, 1), (8, 4), (12, 6), (20, 9))
"""(n, m), for d = 19, 9, 27, 39, 61 with the offset."""
WINDOWS = {"whole": 1.0, "half": 0.5, "tenth": 0.1}
"""Share of the fitted part that a window covers, up to its end."""
HELD_OUT_SHARE = 0.2
TWO_FILES = "two files"
"""In place of a recording's path, if the options input and output name one file for each."""
HELD_OUT, FITTED = "held out", "fitted"
"""Whether the last fifth was held out from the fit of a model or is part of its data."""
LONGEST_VALIDATION = 200_000
"""Largest number of unseen samples; every problem has its own copy."""
READING = {name: (get_args(kind) or (kind,))[0] for name, kind in get_type_hints(ReadOptions).items()}
"""Options of ``Recording.open``, with their types."""
SOLVER, PROXIMAL = "box_active_set", 1e-10


class Recorded(ProblemSet):
    """Every order over every window of one recording."""

    name = "recorded"
    origin = "a recording of yours"
    description = "a recording of your own at several orders and over several windows, the last fifth held out"
    needs: ClassVar = {"recording": "a recording in any known format"}
    takes: ClassVar = {
        "time": "time column",
        "input": "input column",
        "output": "output column",
        **dict.fromkeys(READING, "how the file is read"),
    }

    def names(self) -> Sequence[str]:
        """Names of all orders over all windows."""
        return [f"n{n}-m{m}-{window}" for n, m in self._orders_and_rates[0] for window in WINDOWS]

    @cached_property
    def _whole(self) -> Recording:
        time, input, output = (self.options.get(role) for role in ("time", "input", "output"))
        reading: dict[str, Any] = {
            name: of_text(self.options[name]) for name, of_text in READING.items() if name in self.options
        }
        path = self.options["recording"]
        return Recording.open(None if path == TWO_FILES else path, time, input, output, **reading)

    @cached_property
    def _split(self) -> tuple[Recording, Recording]:
        """The fitted part and the unseen part."""
        fitted = round((1.0 - HELD_OUT_SHARE) * self._whole.length)
        return excerpt(self._whole, slice(fitted)), excerpt(self._whole, slice(fitted, fitted + LONGEST_VALIDATION))

    @cached_property
    def _of_fitted(self) -> HysteresisCreepModel | IdentificationError:
        """The model of the fitted part, or the reason for its absence."""
        try:
            return identify(self._split[0], dynamics="ignore")  # programs (6) are those of a static stage
        except IdentificationError as refusal:
            return refusal

    @cached_property
    def _orders_and_rates(self) -> tuple[Sequence[tuple[int, int]], Sequence[float]]:
        """The orders of all problems, those of the identified model last, and their creep rates."""
        if isinstance(self._of_fitted, IdentificationError):
            return ORDERS, candidate_rates(self._whole.sample_time, self._whole.duration_s)
        s = self._of_fitted.structure
        return [*dict.fromkeys((*ORDERS, (s.n, s.dead_zones // 2)))], s.creep_rates

    def model(self) -> tuple[HysteresisCreepModel, float]:
        """The model of the whole recording, and the error of that of the fitted part on the unseen part."""
        if isinstance(self._of_fitted, IdentificationError):
            raise self._of_fitted
        return identify(self._whole, dynamics="ignore"), self._of_fitted.validate(self._split[1]).fit.rms_percent

    def digests(self) -> dict[str, str]:
        """Whether the unseen part was held out from a model of the fitted part, and from one of the whole recording."""
        return {self._split[0].digest(): HELD_OUT, self._whole.digest(): FITTED}

    def problems(self) -> Iterator[RaceProblem]:
        """Accumulate and certify each window at each order of a selected problem; windows that are too short are left
        out."""
        (recording, unseen), (orders, rates) = self._split, self._orders_and_rates
        fitted, until = recording.length, (*unseen.starts, unseen.length)[1]
        noise, wanted = sensor_noise(self._whole.counted_y), {name.rpartition("-")[0] for name in self.selected}
        for n, m in (order for order in orders if "n{}-m{}".format(*order) in wanted):
            prepared = preprocessed(recording, n, m, rates)
            s = prepared.fit.structure
            for window, share in WINDOWS.items():
                name, start = f"n{n}-m{m}-{window}", max(prepared.skip, round((1.0 - share) * fitted))
                if fitted - start <= s.d:
                    self.left_out[name] = f"{fitted - start} samples are too few for {s.d} weights"
                    continue
                basis = DataBasis(s)
                _update(basis, recording, prepared, 0, start, count=False)
                middle = (start + fitted) // 2
                _update(basis, recording, prepared, start, middle)
                first_half = basis.problem(proximal=PROXIMAL)
                _update(basis, recording, prepared, middle, fitted)
                validation = Validation(s, basis.state.copy(), unseen.x[:until], unseen.counted_y[:until], noise)
                yield certified(self.name, name, basis.problem(proximal=PROXIMAL), validation, neighbours=[first_half])


def _update(
    basis: DataBasis, recording: Recording, prepared: InitialFit, first: int, last: int, count: bool = True
) -> None:
    """Take the samples from ``first`` up to ``last``; a part begins with the states before it."""
    states = dict(zip(recording.starts, prepared.fit.states, strict=True))
    for begin, end in pairwise((first, *(start for start in recording.starts if first < start < last), last)):
        if begin in states:
            basis.state.play[:], basis.state.creep[:] = states[begin].play, states[begin].creep
        basis.update(recording.x[begin:end], recording.counted_y[begin:end], count)


def held_out_recording(problem: RaceProblem) -> Recording:
    """The unseen part of the recording, from any problem of this set."""
    v = problem.validation
    assert v is not None
    return Recording.from_arrays(
        v.x,
        v.y,
        v.structure.sample_time,
        input_unit=v.structure.input_unit,
        output_unit=v.structure.output_unit,
        name="the last fifth of the recording",
    )


def sensor_noise(y: NDArray[np.float64]) -> float:
    """Standard deviation of the white noise of an output (N,), from its third differences, in which the slow part
    cancels.

    White noise of deviation σ has third differences of deviation √20 σ (weights 1, −3, 3, −1). Their median ignores the
    corners of a drive. The result is 0 if most neighbouring samples are equal.

    Examples
    --------
    >>> t = np.arange(20_000) / 1000
    >>> round(sensor_noise(np.sin(t) + 1e-4 * np.random.default_rng(0).normal(size=t.size)) / 1e-4, 1)
    1.0
    """
    return float(np.nanmedian(np.abs(np.diff(y, 3))) / 0.6745 / np.sqrt(20.0))


def excerpt(whole: Recording, samples: slice) -> Recording:
    """A slice of a recording, as a recording of its own with the same parts."""
    recording = Recording.from_arrays(
        whole.x[samples],
        whole.counted_y[samples],
        whole.sample_time,
        input_unit=whole.input_unit,
        output_unit=whole.output_unit,
        name=f"{whole.name}, samples {samples.start or 0} to {min(samples.stop, whole.length) - 1}",
    )
    return replace(recording, starts=whole.part(samples).starts)


@one_thread
def preprocessed(recording: Recording, n: int, m: int, creep_rates: Sequence[float]) -> InitialFit:
    """Model structure with the ranges after the transient, length of the transient, and initial states."""
    return prepare(
        recording, structure_of(recording, n, m, creep_rates), ProgramSolver(SOLVER, PROXIMAL), fit_range=True
    )
