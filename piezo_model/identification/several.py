"""Several recordings of one stage, each of which determines what the others do not, in one model.

    level      all outputs at that of the first recording, by lines over the inputs that each shares with it
    start      searched for each part, since what one recording leaves open the others do not
    dynamics   from the first recording with a mode, in the order of the sampling periods, or else from the one with the
               shortest; the lag of any other one is its own, and is removed
    creep      from the longest recording that distinguishes it from hysteresis, at its rates and possibly faster ones
    weights    each recording counts by the error of a fit of it alone, not by its number of samples

    minimise   Σ_i 1/N_i Σ_k (y_k − c_i − ŷ_k)² / σ_i²,   σ_i² the mean square error of the fit of recording i alone

over common weights, and a level c_i and states before the first sample of each recording (`forward`).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from piezo_model.identification.adequacy import Fit, fit_of
from piezo_model.identification.creep import CreepEvidence, Estimate, determine
from piezo_model.identification.drive import identifiability_of
from piezo_model.identification.dynamics import LagChoice, StaticView
from piezo_model.identification.error_model import (
    IdentificationError,
    ProgramSolver,
    accumulate,
    percent_of,
)
from piezo_model.identification.forward import EXACT, Columns, ForwardFit, fit_forward
from piezo_model.identification.gram_matrix import at_period
from piezo_model.identification.start import SEARCHED, InitialFit
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from piezo_model.units import percent


def concatenate(recordings: Sequence[Recording], weights: Sequence[float] | None = None) -> Recording:
    """Recordings one after another, in the same units; the sampling period is the shortest one.

    Parameters
    ----------
    recordings : sequence of Recording
    weights : sequence of float, optional
        Weight of each recording in a mean over all samples; equal by default.
    """
    first = recordings[0]
    ends = np.cumsum([0, *(recording.length for recording in recordings)])
    x_ends, y_ends = zip(*((recording.x_range, recording.y_range) for recording in recordings), strict=True)
    return Recording(
        name=" and ".join(recording.name for recording in recordings),
        sample_time=min(recording.sample_time for recording in recordings),
        remarks=tuple(f"{recording.name}: {note}" for recording in recordings for note in recording.notes),
        units=" ".join(filter(None, (recording.units for recording in recordings))),
        x=np.concatenate([recording.x for recording in recordings]),
        y=np.concatenate([recording.y for recording in recordings]),
        uncounted=np.concatenate([recording.uncounted for recording in recordings]),
        starts=tuple(
            int(end) + start for end, recording in zip(ends, recordings, strict=False) for start in recording.starts
        ),
        x_range=(float(np.min(x_ends)), float(np.max(x_ends))),
        y_range=(float(np.min(y_ends)), float(np.max(y_ends))),
        input_unit=first.input_unit,
        output_unit=first.output_unit,
        recordings=tuple(recordings),
        weights=tuple(weights or [1.0] * len(recordings)),
    )


@dataclass(frozen=True)
class Start:
    """A recording up to the choice of the orders."""

    recording: Recording
    view: StaticView
    evidence: CreepEvidence


@dataclass(frozen=True)
class SingleFit(Start):
    """One of the recordings, with dynamics if it shows those of the model and otherwise without those that it has, and
    its fit alone."""

    fit: ForwardFit


@dataclass(frozen=True)
class JointStart(Start):
    """Several recordings as one, or a single one."""

    rates: Sequence[tuple[float, ...]]
    """Candidate sets of creep rates: those of the recording that determines creep, alone or with faster ones."""
    levels: Columns
    """Levels of all recordings but the first."""
    singles: Sequence[SingleFit]
    """The recordings; none of a single one."""

    def at_one_level(self, fit: ForwardFit) -> Recording:
        """The recordings with all outputs at the level of the first one, by a joint fit."""
        levels = self.levels.signals @ fit.further[: self.levels.lb.size]
        return replace(self.recording, y=self.recording.y - fit.structure.y_scale * levels)

    def members(self, shares: Sequence[tuple[Recording, ForwardFit, Fit]]) -> Iterator[dict[str, Any]]:
        """The report of each of several recordings, from its share of a joint fit and its errors."""
        for single, (recording, share, errors) in zip(self.singles, shares, strict=False):
            drive = identifiability_of(single.recording, single.view.initial.skip, single.evidence)
            determines = drive.sentence(drive.creep and single.evidence.is_clear, single.view.dynamics is not None)
            rms_percent, alone_percent = (percent_of(errors.span, fit.rms) for fit in (share, single.fit))
            yield {
                "name": recording.name,
                "sample_time_s": recording.sample_time,
                "rms_percent": rms_percent,
                "alone_percent": alone_percent,
                "sentence": f"{recording.name}: RMS error {percent(rms_percent)} of its range, and "
                f"{percent(alone_percent)} with a model of it alone. {determines}",
            }


def align(recordings: Sequence[Recording]) -> list[Recording]:
    """Shift the outputs to the level of the first recording, in the middle of the inputs that each shares with it.

    IdentificationError for recordings without a common input.
    """
    first, result = recordings[0], [recordings[0]]
    for other in recordings[1:]:
        low, high = max(first.x_range[0], other.x_range[0]), min(first.x_range[1], other.x_range[1])
        if low > high:
            raise IdentificationError(f"{first.name} and {other.name}: the drives have no input in common")
        here, there = (np.polyfit(recording.x - 0.5 * (low + high), recording.y, 1)[1] for recording in (first, other))
        shift = float(here - there)
        result.append(replace(other, y=other.y + shift, y_range=(other.y_range[0] + shift, other.y_range[1] + shift)))
    return result


def joint_start(
    recordings: Sequence[Recording],
    first: ModelStructure,
    static_view: Callable[..., StaticView],
    own_lag: LagChoice,
    fit_alone: Callable[[Recording, StaticView, CreepEvidence], ForwardFit],
    qp_solver: ProgramSolver,
) -> JointStart:
    """Start the identification of aligned recordings from the structure of the first fit. ``static_view`` is that of a
    recording, for a structure with its sampling period and, if they differ from the options, for other choices of
    dynamics and lag; ``own_lag`` is the option for the lag of recordings that do not show the dynamics.

    IdentificationError if the output rises with the input in one recording and falls in another.
    """
    views = (
        (recording, static_view(recording, at_period(first, None, recording.sample_time)[0]))
        for recording in sorted(recordings, key=lambda recording: recording.sample_time)
    )
    fastest = next(views)
    shown_by, source = next((view for view in chain([fastest], views) if view[1].has_modes), fastest)

    def fit_single(recording: Recording) -> SingleFit:
        s, known = at_period(first, source.dynamics, recording.sample_time)
        if recording is shown_by:
            view = source
        elif known:
            view = static_view(recording, s, known)
        else:
            view = replace(static_view(recording, s, "ignore", own_lag), dynamics=None)
        fit = view.initial.fit
        member = replace(recording if view.dynamics else fit.recording, uncounted=~fit.counted)
        evidence = determine(fit, qp_solver)
        return SingleFit(member, view, evidence, fit_alone(member, view, evidence))

    singles = [fit_single(recording) for recording in recordings]
    fits = [single.view.initial.fit for single in singles]
    structures = [fit.structure for fit in fits]
    signs = {s.negative_gain: recording.name for recording, s in zip(recordings, structures, strict=True)}
    if len(signs) > 1:
        raise IdentificationError(f"the output rises with the input in {signs[False]}, and falls in {signs[True]}")
    weights = [1.0 / (np.count_nonzero(~single.recording.uncounted) * single.fit.rms**2) for single in singles]
    whole = concatenate([single.recording for single in singles], weights)
    x, y = (np.concatenate([getattr(fit.recording, name) for fit in fits]) for name in ("x", "y"))
    static = replace(whole, x=x, y=y)
    columns = np.repeat(np.eye(len(recordings))[:, 1:], [recording.length for recording in recordings], axis=0)
    levels = Columns.of(columns)
    states, s = [state for fit in fits for state in fit.states], _over_all(structures)
    v = s.inverse_slope_map @ qp_solver.optimum(accumulate(static, ~static.uncounted, s, states, qp_solver))
    fit = fit_forward(static, ~static.uncounted, s, states, v, qp_solver, searched=[True] * len(states), further=levels)
    initial = InitialFit(0, [SEARCHED] * len(states), fit)
    evidence, rates = _creep(singles, whole, s)
    return JointStart(whole, replace(source, initial=initial), evidence, rates, levels, singles)


def _over_all(structures: Sequence[ModelStructure]) -> ModelStructure:
    """A structure over the output ranges of all, at the shortest sampling period."""
    low = min(s.y_centre - abs(s.y_scale) for s in structures)
    high = max(s.y_centre + abs(s.y_scale) for s in structures)
    return replace(
        structures[0],
        y_centre=0.5 * (low + high),
        y_scale=math.copysign(0.5 * (high - low), structures[0].y_scale),
        sample_time=min(s.sample_time for s in structures),
    )


def _creep(
    singles: Sequence[SingleFit], whole: Recording, s: ModelStructure
) -> tuple[CreepEvidence, Sequence[tuple[float, ...]]]:
    """The evidence of the longest recording that distinguishes creep from hysteresis, with the largest upper limit of
    all recordings, and the candidate rates."""
    decisive = max(singles, key=lambda single: (single.evidence.is_clear, single.recording.duration_s))
    evidence, scale = decisive.evidence, decisive.view.initial.fit.structure.y_scale / s.y_scale
    estimates = [single.evidence.creep for single in singles if single.evidence.creep is not None]
    trend = evidence.trend
    if trend is not None:  # over half of the longest recording
        of_longest = decisive.recording.duration_s == whole.duration_s and not evidence.settling
        trend = Estimate(scale * trend.value, scale * trend.se) if of_longest else None
    creep = max(estimates, key=lambda estimate: estimate.limits[1], default=None)
    rates = [evidence.rates]
    while rates[-1] and 100.0 * rates[-1][0] * whole.sample_time <= 1.0 + 1e-9:  # whatever the last bit of the period
        rates.append((float(f"{10.0 * rates[-1][0]:.6g}"), *rates[-1]))
    return replace(evidence, creep=creep, trend=trend, settling=()), rates


def split_fit(recording: Recording, fit: ForwardFit) -> Iterator[tuple[Recording, ForwardFit, Fit]]:
    """Each of several recordings, its share of a joint fit, and its errors."""
    ends = np.cumsum([member.length for member in recording.recordings]).tolist()
    for i, (member, end) in enumerate(zip(recording.recordings, ends, strict=True)):
        samples = slice(end - member.length, end)
        s, dynamics = at_period(fit.structure, fit.dynamics, member.sample_time)
        share = {name: getattr(fit, name)[samples] for name in ("static", "y_model", "error", "counted")}
        levelled = replace(member, y=recording.y[samples])
        errors = levelled.y - s.y_centre - s.y_scale * share["y_model"]
        own_errors = fit_of(levelled, s, errors, 0, float(np.ptp(levelled.y[share["counted"]])))
        own_fit = replace(
            fit,
            **share,
            cost=float(np.mean(share["error"][share["counted"]] ** 2)) + EXACT,
            states=[state for owner, state in zip(recording.owners, fit.states, strict=True) if owner == i],
            structure=s,
            dynamics=dynamics,
            recording=levelled,
        )
        yield levelled, own_fit, own_errors
