"""Anybody's recording, seen by models of several orders over several windows.

The last fifth of the recording is kept back to judge with. The rest is driven through the operators from its first
sample on, from the states and with the sign that `piezo_model.identification.preprocessing` finds, and counted from the
end of a switch-on transient or the start of the window, whichever is later. A recording has an unknown constant, so
every model has an offset, a variable without bounds.

Beside the problems stands the model that `identify` makes of the fitted part, of the orders and rates of the first
problem, so that the times of the race are those of its size. Its error, and that of any other model, is what
``HysteresisCreepModel.validate`` finds on the part that is kept back.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from piezo_model import DataBasis, HysteresisCreepModel, Recording, identify
from piezo_model.identification.identify import check_direction, choose_creep_rates, structure_of
from piezo_model.identification.preprocessing import Preprocessed, preprocess

ORDERS = ((5, 3), (2, 1), (8, 4), (12, 6), (20, 9))
"""(n, m), for d = 19, 9, 27, 39, 61 with the offset."""
WINDOWS = {"whole": 1.0, "half": 0.5, "tenth": 0.1}
"""Share of the fitted part that is counted, up to its end."""
KEPT_BACK = 0.2
LONGEST_VALIDATION = 200_000
"""Samples; every problem carries its own copy."""
READING = {
    "sample_time": float,
    "header_row": int,
    "decimal": str,
    "sheet": str,
    "resample": float,
    "input_unit": str,
    "output_unit": str,
}
"""Options of ``Recording.open`` for what a file does not say, and how each is read from its text."""
SOLVER, PROXIMAL = "box_active_set", 1e-10


class Recorded(ProblemSet):
    """One recording, orders by windows."""

    name = "recorded"
    origin = "a recording of yours"
    description = (
        "a recording of your own at several orders and over several windows, the last fifth kept back to judge"
    )
    needs: ClassVar = {"recording": "a recording in any known format"}
    takes: ClassVar = {
        "time": "time column",
        "input": "input column",
        "output": "output column",
        **dict.fromkeys(READING, "how the file is read"),
    }

    def __len__(self) -> int:
        """Orders times windows."""
        return len(ORDERS) * len(WINDOWS)

    @cached_property
    def _whole(self) -> Recording:
        time, input, output = (self.options.get(role) for role in ("time", "input", "output"))
        reading: dict[str, Any] = {
            name: of_text(self.options[name]) for name, of_text in READING.items() if name in self.options
        }
        return check_direction(Recording.open(self.options["recording"], time, input, output, **reading)).in_memory()

    @cached_property
    def _parts(self) -> tuple[Recording, Recording]:
        """What is fitted and what is kept back."""
        fitted = round((1.0 - KEPT_BACK) * self._whole.length)
        return part(self._whole, slice(fitted)), part(self._whole, slice(fitted, fitted + LONGEST_VALIDATION))

    def model(self) -> tuple[HysteresisCreepModel, float]:
        """The model of the fitted part, and its error on the rest."""
        fitted, unseen = self._parts
        model = identify(
            fitted,
            n=ORDERS[0][0],
            m=ORDERS[0][1],
            creep_rates=choose_creep_rates(fitted.sample_time, fitted.duration_s),
        )
        return model, model.validate(unseen).fit.rms_percent

    def problems(self) -> Iterator[RaceProblem]:
        """Accumulate each window at each order and certify it; windows that are too short are left out."""
        recording, unseen = self._parts
        (x, y), (x_unseen, y_unseen), fitted = recording.arrays(), unseen.arrays(), recording.length
        noise = sensor_noise(self._whole.arrays()[1])
        for n, m in ORDERS:
            found = counted(recording, n, m)
            s = found.structure
            for window, share in WINDOWS.items():
                name, start = f"n{n}-m{m}-{window}", max(found.skip, round((1.0 - share) * fitted))
                if fitted - start <= s.d:
                    self.left_out[name] = f"{fitted - start} samples are too few for {s.d} weights"
                    continue
                basis = DataBasis(s, found.state)
                basis.update(x[:start], y[:start], count=False)
                middle = (start + fitted) // 2
                basis.update(x[start:middle], y[start:middle])
                first_half = basis.problem(proximal=PROXIMAL)
                basis.update(x[middle:], y[middle:])
                validation = Validation(s, basis.state.copy(), x_unseen, y_unseen, noise)
                yield certified(self.name, name, basis.problem(proximal=PROXIMAL), validation, neighbours=[first_half])


def kept_back(problem: RaceProblem) -> Recording:
    """What was kept back of the recording that a problem of this set is made of; every problem carries it."""
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
    """Standard deviation of the white part of an output (N,), from its third differences, in which what is slow
    cancels.

    White noise of deviation σ has third differences of deviation √20 σ (weights 1, −3, 3, −1). Their median takes no
    notice of the corners of a drive. 0 where most neighbouring samples are equal.

    Examples
    --------
    >>> t = np.arange(20_000) / 1000
    >>> round(sensor_noise(np.sin(t) + 1e-4 * np.random.default_rng(0).normal(size=t.size)) / 1e-4, 1)
    1.0
    """
    return float(np.median(np.abs(np.diff(y, 3))) / 0.6745 / np.sqrt(20.0))


def part(whole: Recording, samples: slice) -> Recording:
    """Some samples of a recording, checked like a recording of their own."""
    x, y = whole.arrays()
    return Recording.from_arrays(
        x[samples],
        y[samples],
        whole.sample_time,
        input_unit=whole.input_unit,
        output_unit=whole.output_unit,
        name=f"{whole.name}, samples {samples.start or 0} to {min(samples.stop, whole.length) - 1}",
    )


def counted(recording: Recording, n: int, m: int) -> Preprocessed:
    """A structure over the ranges of the counted part, the first sample of it, and the states at the start."""
    return preprocess(recording, structure_of(recording, n, m), SOLVER, PROXIMAL, None, fit_range=True)
