"""From a recording to a model: the whole of equations (3) to (6) in one call.

What a recording does not say is found out and reported: the states that the actuator started with (`unknown_start`), an
offset and a lag of the sensor (`lag_identification`), and the creep rates that its length can tell apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_model.identification.fit_report import Fit, FitReport, Offset
from piezo_model.identification.fitting import IdentificationError, accumulate, error_percent, optimum, prove
from piezo_model.identification.lag_identification import estimate_lag, without_lag
from piezo_model.identification.unknown_start import counted_y_range, resting_level, settled_from, unknown_start
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure

Vector = NDArray[np.float64]
LagChoice = Literal["estimate", "remove", "ignore"]

IN_MEMORY = 5_000_000
"""Samples up to which a file is read once and kept instead of once for each pass."""


def choose_creep_rates(sample_time: float, duration_s: float) -> tuple[float, ...]:
    """Creep rates in 1/s, decades apart, from the length of the recording to ten sampling periods.

    Examples
    --------
    >>> choose_creep_rates(1e-4, 10.0)
    (1000.0, 100.0, 10.0, 1.0, 0.1)
    """
    slowest = math.ceil(math.log10(1.0 / duration_s) - 1e-9)
    fastest = math.floor(math.log10(0.1 / sample_time) + 1e-9)
    return tuple(10.0**k for k in range(fastest, slowest - 1, -1))


def identify(x: ArrayLike | Recording, y: ArrayLike | None = None, structure: ModelStructure | None = None, *,
             solver: str = "box_active_set", n: int = 5, m: int = 3, creep_rates: Sequence[float] | None = None,
             skip: int | None = None, lag: LagChoice = "estimate", state: OperatorState | None = None,
             proximal: float = 1e-10) -> HysteresisCreepModel:
    """Identify a model from input and output.

    Parameters
    ----------
    x : array (N,) or Recording
        Input in the structure's input unit, or a recording of both.
    y : array (N,)
        Measured output; not with a recording.
    structure : ModelStructure, optional
        Needed for arrays; for a recording one is made of the orders ``n`` and ``m``, the ranges found, a free offset
        and ``creep_rates`` (chosen from its length by default).
    solver : str
        Any registered solver.
    skip : int, optional
        Samples at the start that move the operators and are not counted. By default as many as it takes for the
        operator states to be known, or none when ``state`` is given.
    lag : "estimate", "remove" or "ignore"
        Whether a lag of the sensor is estimated and said, removed from the output as well, or not looked for.
    state : OperatorState, optional
        States before the first sample where they are known, as in a simulation.
    proximal : float
        As of ``IdentificationProblem``.

    Returns
    -------
    HysteresisCreepModel
        With ``.report``: fit, excitation, certificate, lag, offset and sentences that say them.

    Raises
    ------
    IdentificationError, ValueError
        For data that cannot give a model.

    Examples
    --------
    >>> import numpy as np
    >>> structure = ModelStructure.equidistant(n=2, m=1, x_range=(0, 100), y_range=(0, 10), creep_rates=(1.0,),
    ...                                        sample_time=1e-3)
    >>> x = 50 - 50 * np.cos(np.arange(4000) / 100)
    >>> model = identify(x, x / 10, structure)
    >>> bool(model.report["fit"]["max_percent"] < 1e-4)
    True
    """
    if lag not in get_args(LagChoice):
        raise IdentificationError(f"lag must be one of {', '.join(get_args(LagChoice))}, not {lag!r}")
    if skip is not None and skip < 0:
        raise IdentificationError(f"skip must not be negative, not {skip}")
    recording, own_structure = _recording_of(x, y, structure), structure is None
    if structure is None:
        rates = choose_creep_rates(recording.sample_time, recording.duration_s) if creep_rates is None else creep_rates
        structure = ModelStructure.equidistant(n, m, recording.x_range, recording.y_range, rates,
                                               recording.sample_time, offset=True, input_unit=recording.input_unit,
                                               output_unit=recording.output_unit)
    if not math.isclose(structure.sample_time, recording.sample_time, rel_tol=1e-3):
        raise IdentificationError(f"{recording.name}: the sampling period is {recording.sample_time:g} s, and that of the "
                                  f"structure is {structure.sample_time:g} s")
    recording.require(structure.d + 1)
    if skip is None:
        skip = settled_from(recording, structure) if state is None else 0
    if recording.length - skip <= structure.d:
        raise IdentificationError(f"{recording.name}: only {max(recording.length - skip, 0)} of {recording.length} samples "
                                  f"are left after skipping {skip}, too few for {structure.d} weights")
    if own_structure:  # a transient at the start must not stretch the range of the thresholds
        low, high = counted_y_range(recording, skip)
        structure = replace(structure, y_centre=0.5 * (low + high), y_scale=0.5 * (high - low))
    rest = None
    if state is None:
        level = resting_level(recording, structure, skip, solver, proximal)
        state = unknown_start(recording, structure, level)
        rest = structure.x_centre + structure.x_scale * level if structure.creep_rates else None
    found_lag = None
    if lag != "ignore":
        found_lag = estimate_lag(recording, structure, skip, solver, state, proximal, remove=lag == "remove")
        if found_lag is not None and found_lag.removed:
            recording, skip, state = without_lag(recording, structure, found_lag.samples, skip, state)
    problem = accumulate(recording, structure, skip, state, proximal)
    w = optimum(problem, solver)
    model = HysteresisCreepModel.from_weights(structure, w)
    report = FitReport(solver, _forward_error(model, recording, skip, state), problem.excitation_report(),
                       prove(problem, w), found_lag, _offset(problem, w, solver) if structure.offset else None, rest,
                       own_structure and creep_rates is None)
    return replace(model, report=report.to_dict(structure))


def _recording_of(x: ArrayLike | Recording, y: ArrayLike | None, structure: ModelStructure | None) -> Recording:
    if isinstance(x, Recording):
        if y is not None:
            raise IdentificationError("a recording holds its own output, so y must not be given")
        return x.in_memory() if x.length <= IN_MEMORY else x
    if y is None or structure is None:
        raise IdentificationError("identification from arrays needs x, y and a structure")
    return Recording.from_arrays(x, y, structure.sample_time, input_unit=structure.input_unit,
                                 output_unit=structure.output_unit)


def _forward_error(model: HysteresisCreepModel, recording: Recording, skipped: int, state: OperatorState) -> Fit:
    state, squares, worst, skipped_worst, seen = state.copy(), 0.0, 0.0, 0.0, 0
    low, high = math.inf, -math.inf
    for x, y in recording.chunks():
        error = np.abs(model.simulate(x, state) - y)
        head = min(max(skipped - seen, 0), x.size)
        skipped_worst = max(skipped_worst, float(np.max(error[:head], initial=0.0)))
        worst = max(worst, float(np.max(error[head:], initial=0.0)))
        squares += float(np.sum(error[head:] ** 2))
        low, high = float(np.min(y[head:], initial=low)), float(np.max(y[head:], initial=high))
        seen += x.size
    counted, span = recording.length - skipped, high - low
    rms = math.sqrt(squares / counted)
    return Fit(counted, skipped, 100 * rms / span, 100 * worst / span, rms, worst, 100 * skipped_worst / span)


def _offset(problem: IdentificationProblem, w: Vector, solver: str) -> Offset:
    """Solve again without the constant to see what it is worth."""
    s = problem.structure
    without = replace(problem, structure=replace(s, offset=False), P=problem.P[:-1, :-1].copy(),
                      q=problem.q[:-1].copy(), reference=None)
    return Offset(float(w[-1]) * s.x_scale, error_percent(problem, w),
                  error_percent(without, optimum(without, solver)))


