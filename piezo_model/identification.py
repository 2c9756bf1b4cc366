"""From a recording to a model: the whole of equations (3) to (6) in one call.

What a recording does not say is handled here (each is reported): the states that the actuator started with (a play of
threshold r is known once the drive has moved by 2r peak to peak, so the data basis counts from there; the creep states
start at a resting level that is one more unknown), an offset and a lag of the sensor, and the creep rates that the length of the
recording can tell apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

import solvers
from piezo_model.data_basis import DataBasis
from piezo_model.fit_report import Certificate, Fit, FitReport, Lag, Offset
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorArrays, OperatorState
from piezo_model.recordings import Recording
from piezo_model.sensor_lag import HALF_WIDTH, minimise_over_lag, shift_output
from piezo_model.structure import ModelStructure
from solvers.certificate import certify, exact_cost_gap

Vector = NDArray[np.float64]
LagChoice = Literal["estimate", "remove", "ignore"]

LAG_SAMPLES = 100_000
"""Samples that the lag is estimated from: enough for it, and a second of work."""

IN_MEMORY = 5_000_000
"""Samples up to which a file is read once and kept instead of once for each pass."""

LONGEST_LAG = 10
"""Samples of lag looked for."""


class IdentificationError(ValueError):
    """The data do not give a model; the message is one sentence that says why."""


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


def optimum(problem: IdentificationProblem, solver: str) -> Vector:
    """Weights (d,) that solve the program, in unit amplitudes.

    Raises
    ------
    IdentificationError
        If the solver found no answer.
    """
    form = problem.form()
    engine = solvers.get(solver, tier="high")
    engine.setup(form.qp)
    z = engine.solve().copy()
    if not engine.solution().found or not np.all(np.isfinite(z)):
        raise IdentificationError(f"the solver {solver} found no answer")
    return form.weights(np.maximum(z, form.qp.lb))


def prove(problem: IdentificationProblem, w: Vector) -> Certificate:
    """How far the weights (d,) are from the optimum, which is proven in exact arithmetic."""
    form = problem.form()
    z = form.variables(w)
    certificate = certify(form.qp, z)
    gap = exact_cost_gap(form.qp, certificate, z, form.c)
    return Certificate(gap.relative, gap.violation, certificate.unique)


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
        skip = _settled(recording, structure) if state is None else 0
    if recording.length - skip <= structure.d:
        raise IdentificationError(f"{recording.name}: only {max(recording.length - skip, 0)} of {recording.length} samples "
                                  f"are left after skipping {skip}, too few for {structure.d} weights")
    if own_structure:  # a transient at the start must not stretch the range of the thresholds
        low, high = _counted_y_range(recording, skip)
        structure = replace(structure, y_centre=0.5 * (low + high), y_scale=0.5 * (high - low))
    rest = None
    if state is None:
        level = _resting_level(recording, structure, skip, solver, proximal)
        state = _unknown_start(recording, structure, level)
        rest = structure.x_centre + structure.x_scale * level if structure.creep_rates else None
    found_lag = None
    if lag != "ignore":
        found_lag = _estimate_lag(recording, structure, skip, solver, state, proximal, remove=lag == "remove")
        if found_lag is not None and found_lag.removed:
            recording, skip, state = _without_lag(recording, structure, found_lag.samples, skip, state)
    problem = _accumulate(recording, structure, skip, state, proximal)
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


def _settled(recording: Recording, s: ModelStructure) -> int:
    """Index of the first sample at which every play that the drive moves at all is known, whatever it started at."""
    span = recording.x_range[1] - recording.x_range[0]
    needed = max((2.0 * r * s.x_scale for r in s.play_thresholds if 2.0 * r * s.x_scale < span), default=0.0)
    low, high, seen = math.inf, -math.inf, 0
    for x, _ in recording.chunks():
        lows, highs = np.minimum.accumulate(np.minimum(x, low)), np.maximum.accumulate(np.maximum(x, high))
        known = np.flatnonzero(highs - lows >= needed)
        if known.size:
            return seen + int(known[0])
        low, high, seen = lows[-1], highs[-1], seen + x.size
    return seen


def _counted_y_range(recording: Recording, skip: int) -> tuple[float, float]:
    low, high, seen = math.inf, -math.inf, 0
    for _, y in recording.chunks():
        counted = y[max(skip - seen, 0):]
        low, high = float(np.min(counted, initial=low)), float(np.max(counted, initial=high))
        seen += y.size
    return low, high


def _accumulate(recording: Recording, s: ModelStructure, skip: int, state: OperatorState, proximal: float,
                ) -> IdentificationProblem:
    """Run the operators over the whole recording from their states at its start, and count after ``skip`` samples."""
    basis, seen = DataBasis(s, state), 0
    for x, y in recording.chunks():
        head = min(max(skip - seen, 0), x.size)
        basis.update(x[:head], y[:head], count=False)
        basis.update(x[head:], y[head:])
        seen += x.size
    return basis.problem(proximal=proximal)


def _unknown_start(recording: Recording, s: ModelStructure, level: float) -> OperatorState:
    """Return the states of an actuator that rested at ``level``; plays that the drive is too small for never move."""
    state, low, high = OperatorState.at_rest(s, level), *s.unit_input(np.array(recording.x_range))
    state.play[2.0 * OperatorArrays.of(s).r >= high - low] = 0.5 * (low + high)
    return state


def _resting_level(recording: Recording, s: ModelStructure, skip: int, solver: str, proximal: float) -> float:
    """Input in unit amplitudes at which the creep states started: the one unknown of a start that nobody recorded.

    Fast states forget it at once; states that are slower than the recording would pull the fit for all of its length.
    """
    if not s.creep_rates:
        return 0.0

    def error(level: float) -> float:
        problem = _accumulate(recording, s, skip, _unknown_start(recording, s, level), proximal)
        return _error_percent(problem, optimum(problem, solver))

    grid = np.linspace(-1.0, 1.0, 9)
    best = grid[int(np.argmin([error(level) for level in grid]))]
    found = minimize_scalar(error, bounds=(max(best - 0.25, -1.0), min(best + 0.25, 1.0)), method="bounded",
                            options={"xatol": 1e-3})
    return float(found.x)


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


def _error_percent(problem: IdentificationProblem, w: Vector) -> float:
    """RMS of the error (5) as a share of the input's range."""
    return 100.0 * math.sqrt(max(2.0 * problem.cost(w), 0.0)) / (problem.excitation.x_max - problem.excitation.x_min)


def _offset(problem: IdentificationProblem, w: Vector, solver: str) -> Offset:
    """Solve again without the constant to see what it is worth."""
    s = problem.structure
    without = replace(problem, structure=replace(s, offset=False), P=problem.P[:-1, :-1].copy(),
                      q=problem.q[:-1].copy(), reference=None)
    return Offset(float(w[-1]) * s.x_scale, _error_percent(problem, w),
                  _error_percent(without, optimum(without, solver)))


def _without_lag(recording: Recording, s: ModelStructure, lag: float, skip: int, state: OperatorState,
                 ) -> tuple[Recording, int, OperatorState]:
    """Return the recording without the lag, and what is left of ``skip`` and the states where it starts now."""
    x, y = recording.arrays()
    values, kept = shift_output(y, lag)
    start = DataBasis(s, state)
    start.update(x[:kept.start], y[:kept.start], count=False)
    return (Recording.from_arrays(x[kept], values, recording.sample_time, name=recording.name,
                                  input_unit=recording.input_unit, output_unit=recording.output_unit),
            max(skip - kept.start, 0), start.state)


def _estimate_lag(recording: Recording, s: ModelStructure, skip: int, solver: str, state: OperatorState,
                  proximal: float, remove: bool) -> Lag | None:
    """Return the delay of the output with the smallest error (5) left after the fit, over the same samples for all.

    None where the recording is too short for it.
    """
    x, y = next(recording.chunks(skip + LAG_SAMPLES))
    longest = min(LONGEST_LAG, (x.size - skip) // 20)
    start, stop = max(skip, HALF_WIDTH), x.size - HALF_WIDTH - longest  # the fraction's interpolation needs neighbours
    if stop - start <= s.d:
        if remove:
            raise IdentificationError(f"{recording.name}: {x.size} samples are too few to look for a lag")
        return None
    settled = DataBasis(s, state)
    settled.update(x[:start], y[:start], count=False)

    def error(lag: float) -> float:
        values, kept = shift_output(y, lag)
        basis = DataBasis(s, settled.state)
        basis.update(x[start:stop], values[start - kept.start:stop - kept.start])
        problem = basis.problem(proximal=proximal)
        return _error_percent(problem, optimum(problem, solver))

    found = minimise_over_lag(error, longest)
    return Lag(found.lag, remove and found.lag > 0.0, found.cost_without, found.cost, found.at_edge)
