"""From a recording to a model: equations (3) to (6) and the forward fit, in one call.

    start    sign, transient, states before the first sample, a first fit        `start`
    creep    creep and drift, where the data determine them                      `creep`
    orders   n and m, from one Gram matrix of all candidates                     `selection`
    fit      program (6) with its proof, then the smallest error of the output   `error_model`, `forward`
    report   lag, adequacy, intervals, figures of a data sheet                   `sensor_lag`, `adequacy`, `intervals`

Data that the model class does not describe are refused.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from piezo_model import checks
from piezo_model.figures import figures_of
from piezo_model.identification.adequacy import check_adequacy, is_one_way
from piezo_model.identification.creep import Determined, determine
from piezo_model.identification.error_model import (
    IdentificationError,
    Solving,
    accumulate,
    counted_from,
    offset,
    prove,
)
from piezo_model.identification.forward import Columns, ForwardFit, fit_forward
from piezo_model.identification.intervals import intervals
from piezo_model.identification.output_error import output_error
from piezo_model.identification.report import CreepFinding, Drift, Fit, FitReport, percent
from piezo_model.identification.selection import (
    HYSTERESIS_ORDERS,
    SUPERPOSITION_ORDERS,
    Progress,
    Selection,
    select,
    state_on,
)
from piezo_model.identification.sensor_lag import estimate_lag, without_lag
from piezo_model.identification.start import Prepared, clear_gain, prepare, y_range
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording, RecordingError
from piezo_model.recordings.evidence import REASONS
from piezo_model.structure import ModelStructure
from solvers.arrays import Mask, Vector

LagChoice = Literal["estimate", "remove", "ignore"]
Estimator = Literal["forward", "error-model"]

USUAL = 5, 3
"""Orders n and m of the first fit."""
DIRECTION_SAMPLES = 20_000
"""Samples from the start to which both directions are fitted."""
CLEAR = 1.15
"""Smallest ratio of the two errors that contradicts a guess."""
STEPS = 6
"""Most Gauss–Newton steps of the final fit."""


def structure_of(recording: Recording, n: int, m: int, creep_rates: Sequence[float] = ()) -> ModelStructure:
    """Structure with a free offset over the ranges of a recording."""
    return ModelStructure.equidistant(
        n,
        m,
        recording.x_range,
        recording.y_range,
        creep_rates,
        recording.sample_time,
        offset=True,
        input_unit=recording.input_unit,
        output_unit=recording.output_unit,
    )


@dataclass(frozen=True)
class Identification:
    """The options of `identify`."""

    structure: ModelStructure | None
    n: int | None
    m: int | None
    creep_rates: Sequence[float] | None
    skip: int | None
    lag: LagChoice
    state: OperatorState | None
    solver: str
    estimator: Estimator
    proximal: float
    force: bool

    @property
    def first(self) -> tuple[int, int]:
        """Orders of the first fit."""
        return USUAL[0] if self.n is None else self.n, USUAL[1] if self.m is None else self.m

    @property
    def chooses_creep(self) -> bool:
        """Whether the data decide about creep."""
        return self.structure is None and self.creep_rates is None


@threadpool_limits.wrap(limits=1, user_api="blas")  # the same bits on any number of cores, and small matrices sooner
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
    estimator: Estimator = "forward",
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
        In 1/s; empty for a model without creep. By default creep is in the model if the data determine it beside any
        hysteresis (`creep`), and orders that are not given are chosen by an information criterion (`selection`).
    solver : str
        Any registered solver.
    skip : int, optional
        Samples at the start that move the operators and are not counted; by default those of a switch-on transient.
    lag : "estimate", "remove" or "ignore"
        Whether a lag of the sensor is estimated and reported, also removed from the output, or ignored.
    estimator : "forward" or "error-model"
        Whether the weights minimise the error of the output, or are those of the paper's program (6).
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
        With ``.start`` and ``.report``: fit, baseline, excitation, certificate, lag, offset, creep, drift, figures of a
        data sheet with intervals, sentences about them, and the ``digest`` of the recording.
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
        checks.one_of(get_args(Estimator), estimator=estimator)
        checks.whole(0, skip=0 if skip is None else skip)
        checks.require(lambda s: s is None or isinstance(s, ModelStructure), "a ModelStructure", structure=structure)
    recording = check_direction(_recording_of(x, y, structure))
    options = Identification(structure, n, m, creep_rates, skip, lag, state, solver, estimator, proximal, force)

    model = _identified(recording, options, progress)
    return replace(model, report={**model.report, "recording": recording.digest(), "remarks": [*recording.notes]})


@threadpool_limits.wrap(limits=1, user_api="blas")
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
    ways = [part, part.swapped()]
    fits = [prepare(way, structure_of(way, *USUAL), Solving(), fit_range=True) for way in ways]
    errors = [50.0 * math.sqrt(prepared.fit.cost) for prepared in fits]
    either = f"{percent(errors[0])} of the range as they were guessed and {percent(errors[1])} the other way round"
    if any(is_one_way(way.x) for way in ways) or errors[1] < errors[0] <= CLEAR * errors[1]:
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


def _identified(recording: Recording, options: Identification, progress: Progress) -> HysteresisCreepModel:
    """The model of a recording; IdentificationError for a recording that it does not describe."""
    first = options.structure or structure_of(recording, *options.first, options.creep_rates or ())
    recording = recording.in_units(first.input_unit, first.output_unit)
    if not math.isclose(first.sample_time, recording.sample_time, rel_tol=1e-3):
        raise IdentificationError(
            f"{recording.name}: the sampling period is {recording.sample_time:g} s, and that of the "
            f"structure is {first.sample_time:g} s"
        )
    solving, own = Solving(options.solver, options.proximal), options.structure is None
    progress("start", 0, 4)
    prepared = prepare(recording, first, solving, options.skip, options.state, fit_range=own)
    counted = counted_from(recording, prepared.skip)
    progress("creep", 1, 4)
    determined = determine(recording, counted, prepared.fit, solving)
    progress("orders", 2, 4)
    selection, near = _chosen(recording, counted, prepared, determined, options, solving)
    progress("fit", 3, 4)
    return _reported(recording, prepared, determined, selection, near, options, solving)


def _chosen(
    recording: Recording,
    counted: Mask,
    prepared: Prepared,
    determined: Determined,
    options: Identification,
    solving: Solving,
) -> tuple[Selection | None, tuple[ModelStructure, OperatorState, Vector]]:
    """The choice of the orders, and structure, states and weights from which the final fit begins."""
    fit, s = prepared.fit, prepared.structure
    rates = s.creep_rates
    if options.chooses_creep and determined.creep is not None:
        rates = determined.rates
    if options.structure is not None or (rates == s.creep_rates and None not in (options.n, options.m)):
        return None, (s, fit.state, fit.v)
    ns = HYSTERESIS_ORDERS if options.n is None else (options.n,)
    ms = SUPERPOSITION_ORDERS if options.m is None else (options.m,)
    selection = select(recording, counted, fit, determined, rates, solving, ns, ms)
    best = selection.chosen
    choice = selection if None in (options.n, options.m) else None
    return choice, (best.structure, state_on(s, fit.state, best.structure), best.v)


@dataclass(frozen=True)
class Final:
    """The final fit, and the program (6) beside it."""

    recording: Recording
    problem: IdentificationProblem
    optimal: Vector
    """Weights (d,) of the program."""
    fit: ForwardFit
    drift: Columns | None


def _final(
    recording: Recording,
    skip: int,
    near: tuple[ModelStructure, OperatorState, Vector],
    drift: Columns | None,
    creep_limits: Vector | None,
    free_start: bool,
    options: Identification,
    solving: Solving,
) -> Final:
    """Solve (6) and minimise the error of the output from given states and weights, with a drift if the gain is
    clear."""
    (s, state, v), counted = near, counted_from(recording, skip)
    solving.passes += 1
    problem = accumulate(recording, counted, s, state, solving.proximal)
    optimal = solving.optimum(problem)
    if options.estimator == "error-model":
        v = s.inverse_slope_map @ optimal
        return Final(recording, problem, optimal, fit_forward(recording, counted, s, state, v, solving, steps=0), None)

    def fitted(state: OperatorState, v: Vector, further: Columns | None) -> ForwardFit:
        return fit_forward(
            recording,
            counted,
            s,
            state,
            v,
            solving,
            steps=STEPS,
            free_start=free_start,
            further=further,
            creep_limits=creep_limits,
        )

    fit = fitted(state, v, None)
    if drift is not None:
        drifting = fitted(fit.state, fit.v, drift)
        if drifting.cost < (1.0 - clear_gain(fit.error[counted], 1)) * fit.cost:
            return Final(recording, problem, optimal, drifting, drift)
    return Final(recording, problem, optimal, fit, None)


def _reported(
    recording: Recording,
    prepared: Prepared,
    determined: Determined,
    selection: Selection | None,
    near: tuple[ModelStructure, OperatorState, Vector],
    options: Identification,
    solving: Solving,
) -> HysteresisCreepModel:
    """The final fit with its report; IdentificationError if the model class does not describe the recording."""
    skip, (low, high) = prepared.skip, y_range(recording, prepared.skip)
    slope = float(np.mean(prepared.fit.v[prepared.structure.slices[1]]))
    limits = determined.creep_limits(near[0], slope) if options.chooses_creep else None
    searched, span = prepared.start == "searched", high - low
    final = _final(recording, skip, near, _drift(recording, determined), limits, searched, options, solving)
    lag = None
    if options.lag != "ignore":
        lag = estimate_lag(recording, final.fit, skip, final.drift, solving, remove=options.lag == "remove")
        if lag is not None and lag.removed:
            near = near[0], final.fit.state, final.fit.v
            advanced = without_lag(recording, lag.samples)
            final = _final(advanced, skip, near, final.drift, limits, searched, options, solving)
    recording, fit, drift, s = final.recording, final.fit, final.drift, near[0]
    problem, optimal, model = final.problem, final.optimal, HysteresisCreepModel.from_weights(s, final.fit.weights)
    found, _ = output_error(model, recording, skip, fit.state, span)
    straightened = recording if drift is None else _without_drift(recording, fit, drift)
    verdict = check_adequacy(straightened, fit, skip, solving, found)
    if verdict.refusal is not None and not options.force:
        raise IdentificationError(f"{recording.name}: {verdict.refusal}")
    straight = verdict.straight and found.line[1] > 0.0
    if straight:
        model = HysteresisCreepModel.from_weights(s, line(s, found))
        found, _ = output_error(model, recording, skip, fit.state, span)
    known = options.estimator == "forward" and not straight and fit.cost > 0.0
    report = FitReport(
        solver=options.solver,
        estimator=options.estimator,
        fit=found,
        baseline=verdict.baseline,
        hysteresis=verdict.hysteresis,
        refusal=verdict.refusal,
        one_way=verdict.one_way,
        excitation=problem.excitation_report(),
        certificate=None if straight else prove(problem, optimal),
        lag=lag,
        offset=offset(problem, solving, optimal) if s.offset else None,
        start=prepared.start,
        creep=CreepFinding(
            determined.creep is not None,
            options.chooses_creep,
            determined.rates,
            determined.share,
            determined.chi_square,
        ),
        drift=None if drift is None else _drift_finding(fit, determined, recording, span),
        intervals=intervals(fit, fit.error[counted_from(recording, skip)]) if known else None,
        figures=figures_of(model),
        units=recording.units,
        passes=solving.passes,
        programs=solving.programs,
    ).to_dict(s)
    if selection is not None:
        report["selection"] = selection.to_dict()
        report["sentences"].append(selection.sentence)
    return replace(model, report=report, start=fit.state)


def _drift(recording: Recording, determined: Determined) -> Columns | None:
    """The column of a drift, with its bounds."""
    if determined.drift is None:
        return None
    time = np.linspace(-1.0, 1.0, recording.length)
    return Columns.of(time, determined.drift.lowest, determined.drift.highest)


def _without_drift(recording: Recording, fit: ForwardFit, drift: Columns) -> Recording:
    s = fit.structure
    return replace(recording, y=recording.y - s.y_scale * (drift.signals @ fit.further))


def _drift_finding(fit: ForwardFit, determined: Determined, recording: Recording, span: float) -> Drift:
    assert determined.drift is not None  # where there is a column, there is an estimate
    per_s = 2.0 * fit.structure.y_scale / recording.duration_s
    return Drift(
        per_s * float(fit.further[0]),
        abs(per_s) * determined.drift.se,
        100.0 * abs(fit.structure.y_scale) * math.sqrt(fit.cost) / span,
    )


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


def line(s: ModelStructure, fit: Fit) -> Vector:
    """Weights (d,) of the best straight line, without hysteresis and creep."""
    w, (constant, slope) = s.straight_line.copy(), fit.line
    w[s.n + s.middle] = 1.0 / slope
    if s.offset:
        w[-1] = constant / slope
    return w
