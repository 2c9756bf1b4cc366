"""From a recording to a model: equations (3) to (6) and the forward fit, in one call.

    dynamics a resonance or a lag, and the recording as of a stage without it    `dynamics`
    start    sign, transient, states before the first sample, a first fit        `start`
    creep    creep and drift, where the data determine them                      `creep`
    orders   n and m, from one Gram matrix of all candidates                     `selection`
    fit      program (6) with its proof, then the smallest error of the output   `error_model`, `forward`
    judge    errors beside those of a line, adequacy, faults, intervals          `fit_errors`, `adequacy`, `faults`
    report   numbers, and what each finding says of itself                       `report`

Data that the model class does not describe are refused.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.dynamics import Dynamics
from piezo_model.figures import figures_of
from piezo_model.identification.adequacy import Adequacy, check_adequacy
from piezo_model.identification.creep import Bounded, CreepEvidence, Drift, determine
from piezo_model.identification.drive import drive_of, orders_within
from piezo_model.identification.dynamics import DynamicsChoice, LagChoice, StaticView, separate
from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import (
    IdentificationError,
    Solving,
    accumulate,
    counted_from,
    one_thread,
    percent_of,
    prove,
)
from piezo_model.identification.fit_errors import Fit, fit_of
from piezo_model.identification.forward import Columns, ForwardFit, fit_forward
from piezo_model.identification.gram_matrix import SAME_PERIOD
from piezo_model.identification.intervals import intervals
from piezo_model.identification.report import FitReport
from piezo_model.identification.selection import (
    HYSTERESIS_ORDERS,
    SUPERPOSITION_ORDERS,
    Candidate,
    Progress,
    Selection,
    select,
)
from piezo_model.identification.several import Together, aligned, apart, together
from piezo_model.identification.start import USUAL, InitialFit, prepare, structure_of, y_range
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import Fitted, HysteresisCreepModel
from piezo_model.operator_state import OperatorState, States
from piezo_model.recordings import Recording
from piezo_model.recordings.several import Recordings
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

Estimator = Literal["forward", "error-model"]

STEPS = 6
"""Most Gauss–Newton steps of the final fit."""


@dataclass(frozen=True)
class Options:
    """The options of `identify`."""

    structure: ModelStructure | None
    n: int | None
    m: int | None
    creep_rates: Sequence[float] | None
    skip: int | None
    lag: LagChoice
    dynamics: DynamicsChoice | Dynamics
    state: OperatorState | None
    estimator: Estimator
    force: bool

    @property
    def chooses_creep(self) -> bool:
        """Whether the data decide about creep."""
        return self.structure is None and self.creep_rates is None

    def first(self, recording: Recording) -> ModelStructure:
        """Structure of the first fit."""
        n, m = (
            usual if given is None else given
            for given, usual in zip((self.n, self.m), orders_within(recording.x, *USUAL), strict=True)
        )
        return self.structure or structure_of(recording, n, m, self.creep_rates or ())


@one_thread
def identify(
    x: ArrayLike | Recording | Sequence[Recording],
    y: ArrayLike | None = None,
    structure: ModelStructure | None = None,
    *,
    solver: str = "box_active_set",
    n: int | None = None,
    m: int | None = None,
    creep_rates: Sequence[float] | None = None,
    skip: int | None = None,
    lag: LagChoice = "estimate",
    dynamics: DynamicsChoice | Dynamics = "estimate",
    estimator: Estimator = "forward",
    state: OperatorState | None = None,
    proximal: float = 1e-10,
    force: bool = False,
    progress: Progress = lambda what, done, total: None,
) -> HysteresisCreepModel:
    """Identify a model from input and output.

    Parameters
    ----------
    x : array (N,), Recording or sequence of Recording
        Input in the structure's input unit, or a recording of both, which is converted to the structure's units; or
        several of one stage, each with its own sampling period, of which the model has the shortest (`several`).
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
        Whether a lag of the output is estimated, removed as the sensor's, or ignored; beside a resonance it is part of
        the dynamics, and stays in the model.
    dynamics : "estimate", "ignore" or Dynamics
        Whether a resonance and a lag are taken in where the recording determines them, ignored, or known.
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
        With ``.start`` and ``.report``: fit, baseline, excitation, certificate, lag, creep, drift, figures of a data
        sheet with intervals, sentences about them, and the ``digest`` of the recording.
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
        if not isinstance(dynamics, Dynamics):
            checks.one_of(get_args(DynamicsChoice), dynamics=dynamics)
        checks.whole(0, skip=0 if skip is None else skip)
        checks.require(lambda s: s is None or isinstance(s, ModelStructure), "a ModelStructure", structure=structure)
    recordings = _recordings_of(x, y, structure)
    if state is not None and len(recordings) > 1:
        raise IdentificationError("a state is that before one recording, and there are several")
    options = Options(structure, n, m, creep_rates, skip, lag, dynamics, state, estimator, force)

    model = _identified(recordings, options, Solving(solver, proximal), progress)
    digests = tuple(recording.digest() for recording in recordings)
    remarks = [note for recording in recordings for note in recording.notes]
    report = {**model.report, "recording": digests[0], "remarks": remarks}
    later = tuple(States(play=part["play"], creep=part["creep"]) for part in report["parts"])
    return replace(model, report=report, fitted=Fitted(digests[0], report["fit"]["skipped"], later, digests[1:]))


def _identified(
    recordings: Sequence[Recording], options: Options, solving: Solving, progress: Progress
) -> HysteresisCreepModel:
    """The model of recordings; IdentificationError if it does not describe them."""
    given = options.structure or recordings[0]
    recordings = aligned([one.in_units(given.input_unit, given.output_unit) for one in recordings])
    fastest = min(recordings, key=lambda one: one.sample_time)
    first = options.first(Recordings.together(recordings) if len(recordings) > 1 else fastest)
    if not math.isclose(first.sample_time, fastest.sample_time, rel_tol=SAME_PERIOD):
        raise IdentificationError(
            f"{fastest.name}: the sampling period is {fastest.sample_time:g} s, and that of the "
            f"structure is {first.sample_time:g} s"
        )
    for one in recordings:
        if first.creep_rates and (quickest := max(first.creep_rates)) * one.sample_time > 1.0:
            raise IdentificationError(
                f"{one.name}: a creep rate of {quickest:g} per second is above one over the sampling period, "
                f"{1.0 / one.sample_time:g}"
            )
    progress("start", 0, 4)
    fitting = _begun(recordings, first, options, solving)
    progress("orders", 2, 4)
    selection, near = fitting.chosen()
    progress("fit", 3, 4)
    final = fitting.final(near)
    judged = fitting.judged(final)
    if (verdict := judged[0]).refusal is not None and not options.force:
        said = f"{fitting.recording.name}: {verdict.refusal}", *verdict.faults[:1]
        raise IdentificationError(". ".join(said).removesuffix("."))
    return _reported(fitting, final, judged, selection)


Judged = tuple[Adequacy, Fit, Recording, Sequence[tuple[Recording, ForwardFit, Fit]]]
"""Whether a fit is adequate, and its errors; the recording, with outputs at one level, and each of several with its
share of the fit and its errors, beside a drift."""
Near = ForwardFit | Candidate
"""From whose structure, states and weights the final fit begins."""


@dataclass(frozen=True)
class Final:
    """The final fit, and the program (6) beside it."""

    problem: IdentificationProblem
    optimal: Vector
    """Weights (d,) of the program."""
    fit: ForwardFit
    drift: Bounded | None
    """The estimate within which the fit has a drift; None without one."""


@dataclass(frozen=True)
class Fitting:
    """Final fits of a recording, after what was found before them."""

    recording: Recording
    separated: StaticView
    determined: CreepEvidence
    options: Options
    solving: Solving
    together: Together | None = None
    """What is known of several recordings beside that."""

    @property
    def prepared(self) -> InitialFit:
        """The start, as of a static stage."""
        return self.separated.prepared

    @property
    def levels(self) -> Columns:
        """Unknown levels of the output; none of a single recording."""
        return Columns.none(self.recording.length) if self.together is None else self.together.levels

    @property
    def span(self) -> float:
        """The output's full range."""
        low, high = y_range(self.recording, self.prepared.skip)
        return high - low

    def chosen(self) -> tuple[Selection | None, Near]:
        """The choice of the orders, and where the final fit begins."""
        prepared, options, determined = self.prepared, self.options, self.determined
        fit, s = prepared.fit, prepared.structure
        rates: Sequence[tuple[float, ...]] = [s.creep_rates]
        if options.chooses_creep and determined.creep is not None:
            rates = self.together.rates if self.together else [determined.rates]
        if options.structure is not None or (rates == [s.creep_rates] and None not in (options.n, options.m)):
            return None, fit
        recording, orders = self.separated.static, (HYSTERESIS_ORDERS, SUPERPOSITION_ORDERS)
        most = orders_within(self.recording.x, *(largest for *_, largest in orders))
        ns, ms = (
            [order for order in each if order <= limit] if given is None else [given]
            for each, limit, given in zip(orders, most, (options.n, options.m), strict=True)
        )
        counted = counted_from(recording, prepared.skip)
        selection = select(
            recording, counted, fit, determined, rates, self.solving, self.span, self.levels.signals, ns, ms
        )
        return selection if None in (options.n, options.m) else None, selection.chosen

    def final(self, near: Near) -> Final:
        """Solve (6) and minimise the error of the output, with a drift if the gain is clear."""
        recording, s = self.recording, near.structure
        counted, solving = counted_from(recording, self.prepared.skip), self.solving
        parameters = Parameters.known(self.separated.dynamics, s.sample_time)
        problem = accumulate(self.separated.static, counted, s, near.states, solving)
        optimal = solving.optimum(problem)
        if self.options.estimator == "error-model":
            v = s.inverse_slope_map @ optimal
            begun = near.states, v, solving
            fit = fit_forward(recording, counted, s, *begun, steps=0, further=self.levels, parameters=parameters)
            return Final(problem, optimal, fit, None)
        limits = self.determined.creep_limits(s, self.prepared.fit) if self.options.chooses_creep else None

        def fitted(states: Sequence[OperatorState], v: Vector, further: Columns) -> ForwardFit:
            return fit_forward(
                recording,
                counted,
                s,
                states,
                v,
                solving,
                steps=STEPS,
                searched=self.prepared.searched,
                further=further,
                creep_limits=limits,
                parameters=parameters,
            )

        fit = fitted(near.states, near.v, self.levels)
        if (
            fit.cost > self.prepared.fit.cost
        ):  # where the model class does not fit, the prediction of a choice is far off
            fit = min(fit, fitted(near.states, s.inverse_slope_map @ optimal, self.levels), key=lambda fit: fit.cost)
        if (drift := self.determined.drift) is not None:
            column = Columns.of(recording.time, *drift.limits)
            drifting = fitted(fit.states, fit.v, self.levels.beside(column))
            if fit.improved_by(drifting, 1):
                return Final(problem, optimal, drifting, drift)
        return Final(problem, optimal, fit, None)

    def judged(self, final: Final) -> Judged:
        """Judge the fit; of several recordings, for each."""
        fit, s, ignored = final.fit, final.fit.structure, self.options.dynamics == "ignore"
        skip, recording = self.prepared.skip, self.together.levelled(fit) if self.together else self.recording
        modelled = s.y_centre + s.y_scale * fit.y_model
        steady = recording if final.drift is None else replace(recording, y=modelled + s.y_scale * fit.error)
        found = fit_of(recording, s, recording.y - modelled, skip, self.span)
        beside_drift = found if final.drift is None else fit_of(steady, s, steady.y - modelled, skip, self.span)
        shares = [*apart(steady, fit)] if isinstance(steady, Recordings) else [(steady, fit, beside_drift)]
        each = [
            (f"{one.name}: " * (len(shares) > 1), check_adequacy(one, own, skip, errors, ignored))
            for one, own, errors in shares
        ]
        name, verdict = min(each, key=lambda of: of[1].refusal is None)
        refusal = verdict.refusal and name + verdict.refusal
        if self.separated.finding is not None:
            refusal = self.separated.finding.refusal or refusal
        faults = [own_name + fault for own_name, one in each for fault in one.faults]
        return replace(verdict, refusal=refusal, faults=faults), found, recording, shares


def _begun(recordings: Sequence[Recording], first: ModelStructure, options: Options, solving: Solving) -> Fitting:
    """What precedes the choice of the orders."""
    own_range = options.structure is None

    def view(
        recording: Recording,
        s: ModelStructure,
        choice: DynamicsChoice | Dynamics = options.dynamics,
        lag: LagChoice = options.lag,
    ) -> StaticView:
        def start(static: Recording, skip: int | None = options.skip) -> InitialFit:
            return prepare(static, s, solving, skip, options.state, fit_range=own_range)

        return separate(recording, start, choice, lag, options.skip or 0, solving)

    def alone(recording: Recording, separated: StaticView, determined: CreepEvidence) -> ForwardFit:
        fitting = Fitting(recording, separated, determined, options, solving)
        return fitting.final(fitting.chosen()[1]).fit

    if len(recordings) > 1:
        own_lag: LagChoice = "ignore" if options.lag == "ignore" else "remove"
        several = together(recordings, first, view, own_lag, alone, solving)
        return Fitting(several.recording, several.separated, several.determined, options, solving, several)
    recording, separated = recordings[0], view(recordings[0], first)
    prepared = separated.prepared
    determined = determine(separated.static, counted_from(recording, prepared.skip), prepared.fit, solving)
    return Fitting(recording, separated, determined, options, solving)


def _reported(fitting: Fitting, final: Final, judged: Judged, selection: Selection | None) -> HysteresisCreepModel:
    """The model of a final fit, with its report."""
    fit, problem, options, (verdict, found, recording, shares) = final.fit, final.problem, fitting.options, judged
    s, prepared, determined, solving = fit.structure, fitting.prepared, fitting.determined, fitting.solving
    model = HysteresisCreepModel.from_weights(s, fit.weights)
    g, lag = fit.dynamics, fitting.separated.lag
    removed = lag is not None and lag.removed
    apart = {"sensor_delay_s": g.delay_s} if removed and g else {"left_out": g or fitting.separated.left_out}
    model = replace(model, **({"dynamics": g} if g and not removed else apart))
    starts = zip(recording.starts, prepared.starts, fit.states, strict=True)
    per_s = 2.0 * s.y_scale / recording.duration_s
    report = FitReport(
        estimator=options.estimator,
        solving=solving,
        fit=found,
        adequacy=verdict,
        excitation=problem.excitation_report(),
        certificate=prove(problem, final.optimal),
        lag=lag,
        dynamics=fitting.separated.finding,
        start=prepared.starts[0],
        parts=[{"first_sample": first, "start": how, **state.to_dict(s)} for first, how, state in starts][1:],
        drive=drive_of(recording, prepared.skip, determined),
        members=list(fitting.together.members(shares)) if fitting.together else [],
        determined=determined,
        creep_chosen=options.chooses_creep,
        drift=None
        if final.drift is None
        else Drift(per_s * float(fit.further[-1]), abs(per_s) * final.drift.se, percent_of(fitting.span, fit.rms)),
        selection=selection,
        intervals=intervals(fit) if options.estimator == "forward" else None,
        figures=figures_of(model),
        units=recording.units,
    )
    return replace(model, report=report.to_dict(s), start=fit.states[0])


def _recordings_of(
    x: ArrayLike | Recording | Sequence[Recording], y: ArrayLike | None, structure: ModelStructure | None
) -> Sequence[Recording]:
    x = [x] if isinstance(x, Recording) else x
    if isinstance(x, Sequence) and x and all(isinstance(one, Recording) for one in x):
        if y is not None:
            raise IdentificationError("a recording holds its own output, so y must not be given")
        return cast(Sequence[Recording], x)
    if y is None or structure is None:
        raise IdentificationError("identification from arrays needs x, y and a structure")
    units = {"input_unit": structure.input_unit, "output_unit": structure.output_unit}
    return [Recording.from_arrays(cast(ArrayLike, x), y, structure.sample_time, **units)]
