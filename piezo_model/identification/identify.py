"""From a recording to a model: equations (3) to (6) and the forward fit, in one call.

    dynamics a resonance or a lag, and the recording of the same stage without it   `dynamics`
    start    sign, transient, states before the first sample, a first fit           `start`
    creep    creep and drift, if the data determine them                            `creep`
    orders   n and m, from one Gram matrix of all candidates                        `selection`
    fit      program (6) with its proof, then the smallest output error             `error_model`, `forward`
    judge    errors compared with those of a line, adequacy, faults, intervals      `adequacy`, `faults`
    report   numbers and sentences                                                  `report`

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
from piezo_model.identification.adequacy import Adequacy, Fit, check_adequacy, fit_of
from piezo_model.identification.creep import CreepEvidence, Estimate, determine
from piezo_model.identification.drive import identifiability_of, orders_within
from piezo_model.identification.dynamics import DynamicsChoice, LagChoice, StaticView, separate
from piezo_model.identification.dynamics_parameters import Parameters
from piezo_model.identification.error_model import (
    IdentificationError,
    ProgramSolver,
    accumulate,
    one_thread,
    percent_of,
    prove,
)
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
from piezo_model.identification.several import JointStart, align, concatenate, joint_start, split_fit
from piezo_model.identification.start import SEARCHED, USUAL, InitialFit, prepare, structure_of, y_range
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel, Provenance
from piezo_model.operator_state import OperatorState, States
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

Estimator = Literal["forward", "error-model"]


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
        """True if the data decide whether the model has creep."""
        return self.structure is None and self.creep_rates is None

    def first_structure(self, recording: Recording) -> ModelStructure:
        """Structure of the first fit."""
        n, m = (
            default if order is None else order
            for order, default in zip((self.n, self.m), orders_within(recording.x, *USUAL), strict=True)
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
        Input in the structure's input unit; or a recording of input and output, which is converted to the structure's
        units; or several recordings of one stage, each with its own sampling period (`several`). The model has the
        shortest of these periods.
    y : array (N,)
        Measured output; not with a recording.
    structure : ModelStructure, optional
        Required for arrays. For a recording the default has the recording's ranges, a free offset, ``n``, ``m`` and
        ``creep_rates``.
    n, m : int, optional
        Orders of hysteresis and creep, and of the superposition on each side.
    creep_rates : sequence of float, optional
        In 1/s; empty for a model without creep. By default the model has creep if the data distinguish it from
        hysteresis (`creep`), and orders that are not given are chosen by an information criterion (`selection`).
    solver : str
        Any registered solver.
    skip : int, optional
        Samples at the start that move the operators but are not counted; by default those of a switch-on transient.
    lag : "estimate", "remove" or "ignore"
        Whether a lag of the output is estimated, removed as that of the sensor, or ignored. With a resonance, the lag
        is part of the dynamics and stays in the model.
    dynamics : "estimate", "ignore" or Dynamics
        Known dynamics; or whether a resonance and a lag are included if the recording determines them, or ignored.
    estimator : "forward" or "error-model"
        Whether the weights minimise the output error, or are those of the paper's program (6).
    state : OperatorState, optional
        States before the first sample if they are known, as in a simulation; estimated by default.
    proximal : float
        As in ``IdentificationProblem``.
    force : bool
        Return a model that is not adequate, with the reason in its report, instead of raising an error.
    progress : function of (what, done, total), optional

    Returns
    -------
    HysteresisCreepModel
        With ``.start`` and ``.report``: fit, baseline, excitation, certificate, lag, creep, drift, data-sheet figures
        with intervals, sentences about these, and the ``digest`` of the recording.
        ``structure.y_scale`` is negative if the output falls as the input rises.

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
        checks.one_of(get_args(DynamicsChoice), dynamics="estimate" if isinstance(dynamics, Dynamics) else dynamics)
        checks.whole(0, skip=0 if skip is None else skip)
        checks.require(lambda s: s is None or isinstance(s, ModelStructure), "a ModelStructure", structure=structure)
    recordings = _recordings_of(x, y, structure)
    if state is not None and len(recordings) > 1:
        raise IdentificationError("state belongs to one recording, and several were given")
    options = Options(structure, n, m, creep_rates, skip, lag, dynamics, state, estimator, force)

    model = _identify(recordings, options, ProgramSolver(solver, proximal), progress)
    digests = tuple(recording.digest() for recording in recordings)
    report = {
        **model.report,
        "recording": digests[0],
        "remarks": [note for recording in recordings for note in recording.notes],
    }
    later = tuple(States(play=part["play"], creep=part["creep"]) for part in report["parts"])
    return replace(model, report=report, fitted=Provenance(digests[0], report["fit"]["skipped"], later, digests[1:]))


def _identify(
    recordings: Sequence[Recording], options: Options, qp_solver: ProgramSolver, progress: Progress
) -> HysteresisCreepModel:
    """The model of the recordings; IdentificationError if it does not describe them."""
    units = options.structure or recordings[0]
    recordings = align([recording.in_units(units.input_unit, units.output_unit) for recording in recordings])
    fastest = min(recordings, key=lambda recording: recording.sample_time)
    first = options.first_structure(concatenate(recordings) if len(recordings) > 1 else fastest)
    if not math.isclose(first.sample_time, fastest.sample_time, rel_tol=SAME_PERIOD):
        raise IdentificationError(
            f"{fastest.name}: the sampling period is {fastest.sample_time:g} s, but that of the "
            f"structure is {first.sample_time:g} s"
        )
    for recording in recordings:
        if first.creep_rates and (largest := max(first.creep_rates)) * recording.sample_time > 1.0:
            raise IdentificationError(
                f"{recording.name}: a creep rate of {largest:g} per second is above the sampling rate, "
                f"{1.0 / recording.sample_time:g} per second"
            )
    progress("start", 0, 4)
    identification = _begin(recordings, first, options, qp_solver)
    progress("orders", 2, 4)
    selection, guess = identification.choose_orders()
    progress("fit", 3, 4)
    final = identification.fit(guess)
    judgement = identification.judge(final)
    if (verdict := judgement[0]).refusal is not None and not options.force:
        sentences = f"{identification.recording.name}: {verdict.refusal}", *verdict.faults[:1]
        raise IdentificationError(". ".join(sentences).removesuffix("."))
    return _with_report(identification, final, judgement, selection)


Judgement = tuple[Adequacy, Fit, Recording, Sequence[tuple[Recording, ForwardFit, Fit]]]
"""Adequacy and errors of a fit; the recording, with all outputs at one level; and each member recording, with its share
of the fit and its errors beside a trend."""
InitialGuess = ForwardFit | Candidate
"""Its structure, states and weights are the starting point of the final fit."""


@dataclass(frozen=True)
class FinalFit:
    """The final fit, and the program (6) of the same structure."""

    problem: IdentificationProblem
    optimal: Vector
    """Weights (d,) of the program."""
    fit: ForwardFit
    trend: Estimate | None
    """The estimate that bounds the trend of the fit; None without a trend."""


@dataclass(frozen=True)
class Identification(JointStart):
    """An identification after its start: the choice of the orders, the final fit, and its judgement."""

    options: Options
    qp_solver: ProgramSolver

    @property
    def span(self) -> float:
        """The output's full range."""
        low, high = y_range(self.recording, self.view.initial.skip)
        return high - low

    def choose_orders(self) -> tuple[Selection | None, InitialGuess]:
        """The choice of the orders, and the starting point of the final fit."""
        fit, options, evidence = self.view.initial.fit, self.options, self.evidence
        own: Sequence[tuple[float, ...]] = [fit.structure.creep_rates]
        rates = self.rates if options.chooses_creep and evidence.creep is not None else own
        if options.structure is not None or (rates == own and None not in (options.n, options.m)):
            return None, fit
        orders = HYSTERESIS_ORDERS, SUPERPOSITION_ORDERS
        most = orders_within(self.recording.x, *(largest for *_, largest in orders))
        ns, ms = (
            [candidate for candidate in candidates if candidate <= limit] if order is None else [order]
            for candidates, limit, order in zip(orders, most, (options.n, options.m), strict=True)
        )
        selection = select(fit, evidence, rates, self.qp_solver, self.span, self.levels, ns, ms)
        return selection if None in (options.n, options.m) else None, selection.chosen

    def fit(self, guess: InitialGuess) -> FinalFit:
        """Solve (6) and minimise the output error, with a trend if the gain is significant."""
        recording, s = self.recording, guess.structure
        counted, qp_solver = self.view.initial.fit.counted, self.qp_solver
        parameters = None if self.view.dynamics is None else Parameters(self.view.dynamics, s.sample_time)
        problem = accumulate(self.view.initial.fit.recording, counted, s, guess.states, qp_solver)
        optimal = qp_solver.optimum(problem)
        v = s.inverse_slope_map @ optimal
        if self.options.estimator == "error-model":
            fit = fit_forward(
                recording, counted, s, guess.states, v, qp_solver, steps=0, further=self.levels, parameters=parameters
            )
            return FinalFit(problem, optimal, fit, None)
        limits = self.evidence.creep_limits(s, self.view.initial.fit) if self.options.chooses_creep else math.inf

        def fit_from(states: Sequence[OperatorState], v: Vector, further: Columns) -> ForwardFit:
            return fit_forward(
                recording,
                counted,
                s,
                states,
                v,
                qp_solver,
                searched=[start == SEARCHED for start in self.view.initial.starts],
                further=further,
                creep_limits=limits,
                parameters=parameters,
            )

        fit = fit_from(guess.states, guess.v, self.levels)
        if fit.cost > self.view.initial.fit.cost:  # outside the model class the predicted weights are far off
            fit = min(fit, fit_from(guess.states, v, self.levels), key=lambda fit: fit.cost)
        if self.evidence.trend is not None:
            beside = fit_from(fit.states, fit.v, self.levels.append(self.evidence.trend_column(recording)))
            if fit.improved_by(beside, 1):
                return FinalFit(problem, optimal, beside, self.evidence.trend)
        return FinalFit(problem, optimal, fit, None)

    def judge(self, final: FinalFit) -> Judgement:
        """Judge the fit of every recording."""
        fit, s, ignored = final.fit, final.fit.structure, self.options.dynamics == "ignore"
        skip, recording = self.view.initial.skip, self.at_one_level(fit)
        modelled = s.y_centre + s.y_scale * fit.y_model
        steady = recording if final.trend is None else replace(recording, y=modelled + s.y_scale * fit.error)
        errors = fit_of(recording, s, recording.y - modelled, skip, self.span)
        without_trend = errors if final.trend is None else fit_of(steady, s, steady.y - modelled, skip, self.span)
        members = [*split_fit(steady, fit)] if steady.recordings else [(steady, fit, without_trend)]
        verdicts = [
            (f"{member.name}: " * (len(members) > 1), check_adequacy(member, share, skip, member_errors, ignored))
            for member, share, member_errors in members
        ]
        label, verdict = min(verdicts, key=lambda labelled: labelled[1].refusal is None)
        refusal = (self.view.finding and self.view.finding.refusal) or (verdict.refusal and label + verdict.refusal)
        faults = [label + fault for label, member in verdicts for fault in member.faults]
        return replace(verdict, refusal=refusal, faults=faults), errors, recording, members


def _begin(
    recordings: Sequence[Recording], first: ModelStructure, options: Options, qp_solver: ProgramSolver
) -> Identification:
    """The identification up to the choice of the orders."""
    fit_range = options.structure is None

    def static_view(
        recording: Recording,
        s: ModelStructure,
        choice: DynamicsChoice | Dynamics = options.dynamics,
        lag: LagChoice = options.lag,
    ) -> StaticView:
        def start(static: Recording, skip: int | None = options.skip) -> InitialFit:
            return prepare(static, s, qp_solver, skip, options.state, fit_range=fit_range)

        return separate(recording, start, choice, lag, options.skip or 0, qp_solver)

    def alone(recording: Recording, view: StaticView, evidence: CreepEvidence) -> Identification:
        return Identification(
            recording, view, evidence, [evidence.rates], Columns.none(recording.length), [], options, qp_solver
        )

    def fit_alone(recording: Recording, view: StaticView, evidence: CreepEvidence) -> ForwardFit:
        identification = alone(recording, view, evidence)
        return identification.fit(identification.choose_orders()[1]).fit

    if len(recordings) > 1:
        own_lag: LagChoice = "ignore" if options.lag == "ignore" else "remove"
        joint = joint_start(recordings, first, static_view, own_lag, fit_alone, qp_solver)
        return Identification(**vars(joint), options=options, qp_solver=qp_solver)
    recording, view = recordings[0], static_view(recordings[0], first)
    return alone(recording, view, determine(view.initial.fit, qp_solver))


def _with_report(
    identification: Identification, final: FinalFit, judgement: Judgement, selection: Selection | None
) -> HysteresisCreepModel:
    """The model of a final fit, with its report."""
    fit, problem, options, view = final.fit, final.problem, identification.options, identification.view
    verdict, errors, recording, members = judgement
    s, initial, evidence, qp_solver = fit.structure, view.initial, identification.evidence, identification.qp_solver
    g, removed = fit.dynamics, view.lag is not None and view.lag.removed
    known = {"sensor_delay_s": g.delay_s} if removed and g else {"dynamics": g, "left_out": view.left_out}
    model = replace(HysteresisCreepModel.from_weights(s, fit.weights), **known)
    starts = zip(recording.starts, initial.starts, fit.states, strict=True)
    report = FitReport(
        estimator=options.estimator,
        qp_solver=qp_solver,
        fit=errors,
        adequacy=verdict,
        excitation=problem.excitation_report(),
        certificate=prove(problem, final.optimal),
        lag=view.lag,
        dynamics=view.finding,
        start=initial.starts[0],
        parts=[{"first_sample": first, "start": how, **state.to_dict(s)} for first, how, state in starts][1:],
        drive=identifiability_of(recording, initial.skip, evidence),
        members=list(identification.members(members)),
        evidence=evidence,
        creep_chosen=options.chooses_creep,
        trend=None
        if final.trend is None
        else {
            "change": (change := 2.0 * s.y_scale * float(fit.further[-1])),
            "per_s": change / recording.duration_s,
            "se": 2.0 * abs(s.y_scale) * final.trend.se / recording.duration_s,
            "rms_percent": percent_of(identification.span, fit.rms),
        },
        selection=selection,
        intervals=intervals(fit, options.chooses_creep) if options.estimator == "forward" else None,
        figures=figures_of(model),
        units=recording.units,
    )
    return replace(model, report=report.to_dict(s), start=fit.states[0])


def _recordings_of(
    x: ArrayLike | Recording | Sequence[Recording], y: ArrayLike | None, structure: ModelStructure | None
) -> Sequence[Recording]:
    x = [x] if isinstance(x, Recording) else x
    if isinstance(x, Sequence) and x and all(isinstance(recording, Recording) for recording in x):
        if y is not None:
            raise IdentificationError("a recording contains its output, so y must not be given")
        return cast(Sequence[Recording], x)
    if y is None or structure is None:
        raise IdentificationError("identification from arrays needs x, y and a structure")
    return [
        Recording.from_arrays(
            cast(ArrayLike, x),
            y,
            structure.sample_time,
            input_unit=structure.input_unit,
            output_unit=structure.output_unit,
        )
    ]
