"""From a recording to a model: equations (3) to (6) in one call.

Unknown properties of a recording are estimated and reported: the sign, a transient and the initial state
(`preprocessing`), a constant term, a lag of the sensor (`sensor_lag`), and the creep rates that its length can
distinguish. Data that the model class does not describe are refused (`adequacy`).
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Literal, get_args

from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.identification.adequacy import check_adequacy
from piezo_model.identification.fit_report import Fit, FitReport, Offset, percent
from piezo_model.identification.fitting import (
    IdentificationError,
    accumulate,
    error_percent,
    forward_error,
    optimum,
    prove,
)
from piezo_model.identification.initial_state import moving_from, y_range
from piezo_model.identification.model_selection import (
    HYSTERESIS_ORDERS,
    SAMPLES,
    SUPERPOSITION_ORDERS,
    Progress,
    candidate_rates,
    select,
)
from piezo_model.identification.one_frequency import has_one_frequency
from piezo_model.identification.preprocessing import Preprocessed, preprocess, require
from piezo_model.identification.remedies import remedy
from piezo_model.identification.sensor_lag import estimate_lag, without_lag
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording, RecordingError
from piezo_model.recordings.evidence import REASONS
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

LagChoice = Literal["estimate", "remove", "ignore"]

USUAL = 5, 3
"""Default orders n and m."""
DIRECTION_SAMPLES = 20_000
"""Samples from the start to which both directions are fitted."""
CLEAR = 1.25
"""Smallest ratio of the two errors that contradicts a guess."""


class InadequateError(IdentificationError):
    """The model class does not describe the data, or the options do not suit them; ``explained`` is the error of
    another explanation, as a share of the range."""

    def __init__(self, sentence: str, explained: float) -> None:
        super().__init__(sentence)
        self.explained = explained


def choose_creep_rates(recording: Recording) -> tuple[float, ...]:
    """Creep rates in 1/s, one per decade, from the length of the recording to ten sampling periods; none if its drive
    has one frequency.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(10_000) / 1000
    >>> [choose_creep_rates(Recording.from_arrays(x, x, 1e-3)) for x in (np.sin(t * t), np.sin(t))]
    [(100.0, 10.0, 1.0), ()]
    """
    if has_one_frequency(recording):
        return ()
    return candidate_rates(recording.sample_time, recording.duration_s, per_decade=1)


def structure_of(recording: Recording, n: int, m: int, creep_rates: Sequence[float] | None = None) -> ModelStructure:
    """Structure with a free offset over the ranges of a recording; by default with the creep rates of
    `choose_creep_rates`."""
    rates = choose_creep_rates(recording) if creep_rates is None else creep_rates
    return ModelStructure.equidistant(
        n,
        m,
        recording.x_range,
        recording.y_range,
        rates,
        recording.sample_time,
        offset=True,
        input_unit=recording.input_unit,
        output_unit=recording.output_unit,
    )


def identify(
    x: ArrayLike | Recording,
    y: ArrayLike | None = None,
    structure: ModelStructure | None = None,
    *,
    solver: str = "box_active_set",
    n: int | None = None,
    m: int | None = None,
    creep_rates: Sequence[float] | None = None,
    skip: int | None = None,
    lag: LagChoice = "estimate",
    state: OperatorState | None = None,
    proximal: float = 1e-10,
    force: bool = False,
    progress: Progress = lambda what, done, total: None,
) -> HysteresisCreepModel:
    """Identify a model from input and output.

    Parameters
    ----------
    x : array (N,) or Recording
        Input in the structure's input unit, or a recording of both, which is converted to the structure's units.
    y : array (N,)
        Measured output; not with a recording.
    structure : ModelStructure, optional
        Required for arrays; for a recording the default has its ranges, a free offset, ``n``, ``m`` and
        ``creep_rates``.
    n, m : int, optional
        Orders of hysteresis and creep, and of the superposition on each side.
    creep_rates : sequence of float, optional
        In 1/s; empty for a model without creep. Orders and rates that are not given are chosen by cross-validation
        (`model_selection`) if the drive makes at least ten excursions, and otherwise n = 5, m = 3 and one rate per
        decade (`choose_creep_rates`). A drive of one frequency determines no creep, so no rates are chosen for it.
    solver : str
        Any registered solver.
    skip : int, optional
        Samples at the start that move the operators and are not counted; by default those of a switch-on transient.
    lag : "estimate", "remove" or "ignore"
        Whether a lag of the sensor is estimated and reported, also removed from the output, or ignored.
    state : OperatorState, optional
        States before the first sample if they are known, as in a simulation; estimated by default.
    proximal : float
        As of ``IdentificationProblem``.
    force : bool
        Whether to return a model that is not adequate, with the reason in its report, instead of an error.
    progress : function of (what, done, total), optional

    Returns
    -------
    HysteresisCreepModel
        With ``.start`` and ``.report``: fit, baseline, excitation, certificate, lag, offset and sentences about them,
        and the ``digest`` of the recording.
        Its structure is inverted if the output falls as the input rises.

    Raises
    ------
    IdentificationError, ValueError
        The data cannot give a model, or the model class does not describe them.

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
    with checks.refusing(IdentificationError):
        checks.one_of(get_args(LagChoice), lag=lag)
        checks.whole(0, skip=0 if skip is None else skip)
        checks.require(lambda s: s is None or isinstance(s, ModelStructure), "a ModelStructure", structure=structure)
    recording = check_direction(_recording_of(x, y, structure))
    usual_n, usual_m = (usual if order is None else order for order, usual in zip((n, m), USUAL, strict=True))
    fitted = partial(
        _fitted,
        recording,
        structure=structure,
        n=usual_n,
        m=usual_m,
        creep_rates=creep_rates,
        skip=skip,
        solver=solver,
        lag=lag,
        state=state,
        proximal=proximal,
        force=force,
    )
    progress("identifying", 0, 1)
    try:
        model = fitted()
    except InadequateError as refusal:
        way_out = remedy(fitted, recording, skip or 0, usual_m if structure is None else 0, refusal.explained)
        raise IdentificationError(f"{refusal}{way_out}") from None
    if (
        structure is None
        and None in (n, m, creep_rates)
        and model.report["hysteresis"]
        and model.report["refusal"] is None
    ):
        model = _selected(recording, model, fitted, n, m, creep_rates, solver, progress)
    return replace(model, report={**model.report, "recording": recording.digest(), "remarks": [*recording.remarks]})


def _selected(
    recording: Recording,
    model: HysteresisCreepModel,
    fitted: Callable[..., HysteresisCreepModel],
    n: int | None,
    m: int | None,
    creep_rates: Sequence[float] | None,
    solver: str,
    progress: Progress,
) -> HysteresisCreepModel:
    """The model with the orders and rates chosen by cross-validation, except given ones, and the choice in its
    report."""
    assert model.start is not None  # every fit sets it
    first = int(model.report["fit"]["skipped"])
    s, head = model.structure, recording.head(moving_from(recording, first) + SAMPLES)
    selection = select(
        head.x,
        head.counted_y,
        s,
        model.start,
        first,
        solver,
        ns=HYSTERESIS_ORDERS if n is None else (s.n,),
        ms=SUPERPOSITION_ORDERS if m is None else (s.dead_zones // 2,),
        rates=None if creep_rates is None and s.creep_rates else s.creep_rates,
        progress=progress,
    )
    if selection is None:
        return model
    chosen = selection.chosen
    if chosen != selection.default:
        progress("identifying", 0, 1)
        other = None
        with suppress(InadequateError):
            other = fitted(n=chosen.n, m=chosen.m, creep_rates=chosen.creep_rates)
        if other and other.report["baseline"]["model_percent"] <= model.report["baseline"]["model_percent"]:
            model = other
        else:  # the default has the smaller error of the output on held-out data
            selection = replace(selection, chosen=selection.default, rejected=chosen)
    sentences = [*model.report["sentences"], selection.sentence]
    return replace(model, report={**model.report, "selection": selection.to_dict(), "sentences": sentences})


def check_direction(recording: Recording) -> Recording:
    """The recording, with input and output swapped if they were guessed by their values and a fit contradicts that.

    The guess (`piezo_model.recordings.evidence`) depends on the sense of the loops alone, which an open path or a drift
    reverses. A model is fitted in both directions: the operators can only lag, so the drive explains the output and
    not vice versa.

    Raises
    ------
    RecordingError
        Input and output were guessed, and the fits do not distinguish them.
    """
    if recording.uncounted.any() or not {recording.reasons.get(role) for role in ("input", "output")} <= {*REASONS}:
        return recording
    part = recording.head(DIRECTION_SAMPLES)
    rates = candidate_rates(part.sample_time, part.duration_s, per_decade=1)  # of one frequency too: creep lags as well
    reports = [
        _fitted(direction, None, *USUAL, rates, None, "box_active_set", "ignore", None, 1e-10, force=True).report
        for direction in (part, part.swapped())
    ]
    errors = [float(report["fit"]["rms_percent"]) for report in reports]
    either = f"{percent(errors[0])} of the range as they were guessed and {percent(errors[1])} the other way round"
    if any(report["one_way"] for report in reports) or errors[1] < errors[0] <= CLEAR * errors[1]:
        raise RecordingError(
            f"{recording.name}: cannot tell which column is the input and which the output: a model "
            f"leaves {either}; name them with --input and --output"
        )
    reason = (
        f"because a model leaves {percent(min(errors))} of the range that way and {percent(max(errors))} the "
        "other way round"
    )
    reasons = {role: reason if role in ("input", "output") else why for role, why in recording.reasons.items()}
    return replace(recording if errors[0] <= errors[1] else recording.swapped(), reasons=reasons)


def _fitted(
    recording: Recording,
    structure: ModelStructure | None,
    n: int,
    m: int,
    creep_rates: Sequence[float] | None,
    skip: int | None,
    solver: str,
    lag: LagChoice,
    state: OperatorState | None,
    proximal: float,
    force: bool,
) -> HysteresisCreepModel:
    """The model of a recording; InadequateError for a recording that it does not describe."""
    own_structure = structure is None
    structure = structure_of(recording, n, m, creep_rates) if structure is None else structure
    recording = recording.in_units(structure.input_unit, structure.output_unit)
    one_frequency = not structure.creep_rates and has_one_frequency(recording)
    if not math.isclose(structure.sample_time, recording.sample_time, rel_tol=1e-3):
        raise IdentificationError(
            f"{recording.name}: the sampling period is {recording.sample_time:g} s, and that of the "
            f"structure is {structure.sample_time:g} s"
        )
    if state is None:
        counted = preprocess(recording, structure, solver, proximal, skip, fit_range=own_structure)
    else:
        counted = Preprocessed(structure, skip or 0, state, None)
        require(recording, structure, counted.skip)
    structure, skip, state, rest = counted
    low, high = y_range(recording, skip)
    start, found_lag = state, None
    if lag != "ignore":
        found_lag = estimate_lag(recording, structure, skip, solver, state, proximal, remove=lag == "remove")
        if found_lag is not None and found_lag.removed:
            recording, skip, state = without_lag(recording, structure, found_lag.samples, skip, state)
    problem = accumulate(recording, structure, skip, state, proximal)
    w = optimum(problem, solver)
    model = HysteresisCreepModel.from_weights(structure, w)
    fit, _ = forward_error(model, recording, skip, state, high - low)
    verdict = check_adequacy(recording, model, skip, state, fit, solver, proximal)
    if verdict.refusal is not None and not force:
        raise InadequateError(f"{recording.name}: {verdict.refusal.why}", verdict.refusal.explained)
    straight = verdict.straight and fit.line[1] > 0.0
    if straight:
        w = line(structure, fit)
        model = HysteresisCreepModel.from_weights(structure, w)
        fit, _ = forward_error(model, recording, skip, state, high - low)
    report = FitReport(
        solver,
        fit,
        verdict.baseline,
        verdict.hysteresis,
        verdict.refusal and verdict.refusal.why,
        verdict.one_way,
        problem.excitation_report(),
        None if straight else prove(problem, w),
        found_lag,
        _offset(problem, w, solver) if structure.offset else None,
        None if rest is None else structure.x_centre + structure.x_scale * rest,
        own_structure and creep_rates is None,
        recording.units,
        one_frequency,
    )
    return replace(model, report=report.to_dict(structure), start=start)


def _recording_of(x: ArrayLike | Recording, y: ArrayLike | None, structure: ModelStructure | None) -> Recording:
    if isinstance(x, Recording):
        if y is not None:
            raise IdentificationError("a recording holds its own output, so y must not be given")
        return x
    if y is None or structure is None:
        raise IdentificationError("identification from arrays needs x, y and a structure")
    return Recording.from_arrays(
        x, y, structure.sample_time, input_unit=structure.input_unit, output_unit=structure.output_unit
    )


def _offset(problem: IdentificationProblem, w: Vector, solver: str) -> Offset:
    """The offset, with the error of the optimum without it."""
    s = problem.structure
    without = replace(
        problem, structure=replace(s, offset=False), P=problem.P[:-1, :-1].copy(), q=problem.q[:-1].copy()
    )
    return Offset(float(w[-1]) * s.x_scale, error_percent(problem, w), error_percent(without, optimum(without, solver)))


def line(s: ModelStructure, fit: Fit) -> Vector:
    """Weights (d,) of the best straight line, without hysteresis and creep."""
    w, (constant, slope) = s.straight_line.copy(), fit.line
    w[s.n + s.middle] = 1.0 / slope
    if s.offset:
        w[-1] = constant / slope
    return w
