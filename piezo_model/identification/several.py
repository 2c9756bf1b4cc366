"""Several recordings of one stage, of which each determines what the others do not: one model.

    level      outputs at that of the first recording, by lines over the inputs that it shares with each
    start      searched for each part, since what one recording leaves open the others do not
    dynamics   from the recording with the shortest sampling period; a lag of another one is its own, and is removed
    creep      from the longest recording that tells it from hysteresis, at its rates and perhaps faster ones
    weights    each recording counts by the error of a fit of it alone, not by its number of samples

    minimise   Σ_i 1/N_i Σ_k (y_k − c_i − ŷ_k)² / σ_i²,   σ_i² the mean square error of the fit of recording i alone

over common weights, and a level c_i and states before the first sample of each recording (`forward`).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from piezo_model.identification.creep import Bounded, CreepEvidence, candidate_rates, determine
from piezo_model.identification.drive import drive_of
from piezo_model.identification.dynamics import LagChoice, StaticView
from piezo_model.identification.error_model import IdentificationError, Solving, accumulate, counted_from, percent_of
from piezo_model.identification.fit_errors import Fit, fit_of
from piezo_model.identification.forward import EXACT, Columns, ForwardFit, fit_forward
from piezo_model.identification.gram_matrix import at_period
from piezo_model.identification.start import SEARCHED, InitialFit
from piezo_model.recordings import Recording
from piezo_model.recordings.several import Recordings
from piezo_model.structure import ModelStructure
from piezo_model.units import percent

AsStatic = Callable[..., StaticView]
"""A recording as of a static stage, for a structure with its sampling period, and perhaps for other choices of dynamics
and lag than those of the options."""


@dataclass(frozen=True)
class Alone:
    """A recording, and what it says alone."""

    recording: Recording
    """With its dynamics if it shows those of the model, and without those that it has otherwise."""
    view: StaticView
    evidence: CreepEvidence
    fit: ForwardFit

    @property
    def sentence(self) -> str:
        """What the drive determines."""
        drive = drive_of(self.recording, self.view.prepared.skip, self.evidence)
        return drive.sentence(drive.creep and self.evidence.is_clear, self.view.dynamics is not None)


@dataclass(frozen=True)
class Together:
    """Several recordings as one, and what precedes the choice of the orders."""

    recording: Recordings
    separated: StaticView
    determined: CreepEvidence
    rates: Sequence[tuple[float, ...]]
    """Rates that creep may have: those of the recording that determines it, and faster ones, as it may go on."""
    levels: Columns
    """Those of the recordings but the first."""
    alone: Sequence[Alone]

    def levelled(self, fit: ForwardFit) -> Recordings:
        """The recordings with outputs at the level of the first one, after a fit of all."""
        levels = self.levels.signals @ fit.further[: self.levels.low.size]
        return replace(self.recording, y=self.recording.y - fit.structure.y_scale * levels)

    def members(self, shares: Sequence[tuple[Recording, ForwardFit, Fit]]) -> Iterator[dict[str, Any]]:
        """For the report, of each recording from its share of a fit of all, its errors beside a drift and its drive."""
        for alone, (one, own, found) in zip(self.alone, shares, strict=True):
            rms_percent, alone_percent = (percent_of(found.span, each.rms) for each in (own, alone.fit))
            yield {
                "name": one.name,
                "sample_time_s": one.sample_time,
                "rms_percent": rms_percent,
                "alone_percent": alone_percent,
                "sentence": f"{one.name}: RMS error {percent(rms_percent)} of its range, and {percent(alone_percent)} "
                f"with a model of it alone. {alone.sentence}",
            }


def aligned(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings with outputs at the level of the first one, in the middle of the inputs that it shares with each.

    IdentificationError for recordings without a common input.
    """
    first, result = recordings[0], [recordings[0]]
    for other in recordings[1:]:
        low, high = max(first.x_range[0], other.x_range[0]), min(first.x_range[1], other.x_range[1])
        if low > high:
            raise IdentificationError(f"{first.name} and {other.name}: the drives have no input in common")
        here, there = (np.polyfit(one.x - 0.5 * (low + high), one.y, 1)[1] for one in (first, other))
        shift = float(here - there)
        result.append(replace(other, y=other.y + shift, y_range=(other.y_range[0] + shift, other.y_range[1] + shift)))
    return result


def together(
    recordings: Sequence[Recording],
    first: ModelStructure,
    as_static: AsStatic,
    own_lag: LagChoice,
    fit_alone: Callable[[Recording, StaticView, CreepEvidence], ForwardFit],
    solving: Solving,
) -> Together:
    """Start the identification of aligned recordings from the structure of the first fit; ``own_lag`` is what becomes
    of the lag of a recording that does not show the dynamics.

    IdentificationError if the output rises with the input in one and falls in another.
    """
    fastest = min(recordings, key=lambda one: one.sample_time)
    source = as_static(fastest, first)

    def on_its_own(one: Recording) -> Alone:
        s, known = at_period(first, source.dynamics, one.sample_time)
        view = source
        if one is not fastest:
            view = as_static(one, s, known) if known else replace(as_static(one, s, "ignore", own_lag), dynamics=None)
        counted = counted_from(view.static, view.prepared.skip)
        shown = replace(one if view.dynamics else view.static, uncounted=~counted)
        evidence = determine(view.static, counted, view.prepared.fit, solving)
        return Alone(shown, view, evidence, fit_alone(shown, view, evidence))

    alone = [on_its_own(one) for one in recordings]
    structures = [each.view.prepared.structure for each in alone]
    signs = {s.negative_gain: one.name for one, s in zip(recordings, structures, strict=True)}
    if len(signs) > 1:
        raise IdentificationError(f"the output rises with the input in {signs[False]}, and falls in {signs[True]}")
    weights = [1.0 / (np.count_nonzero(~each.recording.uncounted) * each.fit.rms**2) for each in alone]
    whole = Recordings.together([each.recording for each in alone], weights)
    x, y = (np.concatenate([getattr(each.view.static, name) for each in alone]) for name in ("x", "y"))
    static = replace(whole, x=x, y=y)
    columns = np.repeat(np.eye(len(recordings))[:, 1:], [one.length for one in recordings], axis=0)
    free = np.full(len(recordings) - 1, np.inf)
    levels = Columns(columns, -free, free)
    states, s = [state for each in alone for state in each.view.prepared.fit.states], _over_all(structures)
    v = s.inverse_slope_map @ solving.optimum(accumulate(static, ~static.uncounted, s, states, solving))
    fit = fit_forward(static, ~static.uncounted, s, states, v, solving, searched=[True] * len(states), further=levels)
    prepared = InitialFit(s, 0, [SEARCHED] * len(states), fit)
    determined, rates = _creep(alone, whole, s)
    return Together(whole, replace(source, static=static, prepared=prepared), determined, rates, levels, alone)


def _over_all(structures: Sequence[ModelStructure]) -> ModelStructure:
    """A structure over the output ranges of all, at the shortest sampling period."""
    low = min(one.y_centre - abs(one.y_scale) for one in structures)
    high = max(one.y_centre + abs(one.y_scale) for one in structures)
    return replace(
        structures[0],
        y_centre=0.5 * (low + high),
        y_scale=math.copysign(0.5 * (high - low), structures[0].y_scale),
        sample_time=min(one.sample_time for one in structures),
    )


def _creep(
    alone: Sequence[Alone], whole: Recordings, s: ModelStructure
) -> tuple[CreepEvidence, Sequence[tuple[float, ...]]]:
    """What the longest recording that tells creep from hysteresis says of it, with the largest limit of all, and the
    rates that it may have."""
    decisive = max(alone, key=lambda each: (each.evidence.is_clear, each.recording.duration_s))
    evidence, scale = decisive.evidence, decisive.view.prepared.structure.y_scale / s.y_scale
    found = [each.evidence.creep for each in alone if each.evidence.creep is not None]
    drift = evidence.drift
    if drift is not None:  # over half of the longest recording
        of_longest = decisive.recording.duration_s == whole.duration_s
        drift = Bounded(scale * drift.value, scale * drift.se) if of_longest else None
    every = candidate_rates(whole.sample_time, whole.duration_s)
    slower = max(evidence.rates, default=math.inf)
    creep = max(found, key=lambda one: one.limits[1], default=None)
    return replace(evidence, creep=creep, drift=drift), [every[k:] for k, rate in enumerate(every) if rate >= slower]


def apart(recording: Recordings, fit: ForwardFit) -> Iterator[tuple[Recording, ForwardFit, Fit]]:
    """Each of several recordings, its share of a fit of all, and the errors of that."""
    for i, (one, samples) in enumerate(zip(recording.recordings, recording.members, strict=True)):
        s, dynamics = at_period(fit.structure, fit.dynamics, one.sample_time)
        own = {name: getattr(fit, name)[samples] for name in ("static", "y_model", "error", "counted")}
        own["cost"] = float(np.mean(own["error"][own["counted"]] ** 2)) + EXACT
        own["states"] = [state for owner, state in zip(recording.owners, fit.states, strict=True) if owner == i]
        alike = replace(one, y=recording.y[samples])
        errors = alike.y - s.y_centre - s.y_scale * own["y_model"]
        found = fit_of(alike, s, errors, 0, float(np.ptp(alike.y[own["counted"]])))
        yield alike, replace(fit, **own, structure=s, dynamics=dynamics, recording=alike), found
