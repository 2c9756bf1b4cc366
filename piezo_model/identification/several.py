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

View = Callable[..., StaticView]
"""A recording as of a static stage, for a structure with its sampling period, and perhaps for other choices of dynamics
and lag than those of the options."""


@dataclass(frozen=True)
class Member:
    """One of several recordings in a report."""

    name: str
    sample_time_s: float
    rms_percent: float
    """RMS error on it beside a drift, per cent of its range."""
    alone_percent: float
    """That of a model of it alone."""
    drive: str
    """What its drive determines, in a sentence."""

    @property
    def sentence(self) -> str:
        """The errors, and what the recording is good for."""
        return (
            f"{self.name}: RMS error {percent(self.rms_percent)} of its range, and {percent(self.alone_percent)} with "
            f"a model of it alone. {self.drive}"
        )


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
    drives: Sequence[str]
    """What each recording determines, in a sentence."""
    alone: Sequence[float]
    """RMS error of a fit of each recording alone, output unit."""

    def levelled(self, fit: ForwardFit) -> Recordings:
        """The recordings with outputs at the level of the first one, after a fit of all."""
        levels = self.levels.signals @ fit.further[: self.levels.low.size]
        return replace(self.recording, y=self.recording.y - fit.structure.y_scale * levels)

    def members(self, fit: ForwardFit) -> Iterator[Member]:
        """What the report says of each recording after a fit of all."""
        for drive, alone, (one, own, found) in zip(
            self.drives, self.alone, apart(self.levelled(fit), fit), strict=True
        ):
            error, alone = abs(own.structure.y_scale) * math.sqrt(own.cost), percent_of(found.span, alone)
            yield Member(one.name, one.sample_time, percent_of(found.span, error), alone, drive)


def aligned(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings with outputs at the level of the first one, in the middle of the inputs that it shares with each.

    IdentificationError for recordings without a common input.
    """
    first, result = recordings[0], [recordings[0]]
    for other in recordings[1:]:
        low, high = max(first.x_range[0], other.x_range[0]), min(first.x_range[1], other.x_range[1])
        if low > high:
            raise IdentificationError(f"{first.name} and {other.name}: the drives have no input in common")
        here, there = (_on_line(one, 0.5 * (low + high)) for one in (first, other))
        shift = here - there
        result.append(replace(other, y=other.y + shift, y_range=(other.y_range[0] + shift, other.y_range[1] + shift)))
    return result


def _on_line(recording: Recording, x: float) -> float:
    """Output at an input, on the best straight line."""
    slope = np.cov(recording.x, recording.y)[0, 1] / recording.x.var(ddof=1)
    return float(recording.y.mean() + slope * (x - recording.x.mean()))


def together(
    recordings: Sequence[Recording],
    first: ModelStructure,
    view: View,
    own_lag: LagChoice,
    fit_alone: Callable[[Recording, StaticView, CreepEvidence], ForwardFit],
    solving: Solving,
) -> Together:
    """Start the identification of aligned recordings from the structure of the first fit; ``own_lag`` is what becomes
    of the lag of a recording that does not show the dynamics.

    IdentificationError if the output rises with the input in one and falls in another.
    """
    fastest = min(recordings, key=lambda one: one.sample_time)
    source = view(fastest, first)

    def viewed(one: Recording) -> StaticView:
        s, known = at_period(first, source.dynamics, one.sample_time)
        if one is fastest:
            return source
        return view(one, s, known) if known else replace(view(one, s, "ignore", own_lag), dynamics=None)

    views = [viewed(one) for one in recordings]
    signs = {view.prepared.structure.negative_gain: one.name for one, view in zip(recordings, views, strict=True)}
    if len(signs) > 1:
        raise IdentificationError(f"the output rises with the input in {signs[False]}, and falls in {signs[True]}")
    counted = [counted_from(view.static, view.prepared.skip) for view in views]
    evidence = [
        determine(view.static, used, view.prepared.fit, solving) for view, used in zip(views, counted, strict=True)
    ]
    shown = [one if view.dynamics else view.static for one, view in zip(recordings, views, strict=True)]
    alone = [fit_alone(*each) for each in zip(shown, views, evidence, strict=True)]
    errors = [abs(fit.structure.y_scale) * math.sqrt(fit.cost) for fit in alone]
    weights = [1.0 / (np.count_nonzero(used) * error**2) for used, error in zip(counted, errors, strict=True)]
    whole, static = (
        Recordings.together([replace(one, uncounted=~used) for one, used in zip(of, counted, strict=True)], weights)
        for of in (shown, [view.static for view in views])
    )
    columns = np.repeat(np.eye(len(recordings))[:, 1:], [one.length for one in recordings], axis=0)
    free = np.full(len(recordings) - 1, np.inf)
    levels = Columns(columns, -free, free)
    states = [state for view in views for state in view.prepared.fit.states]
    s = _of_all([view.prepared.structure for view in views], source.prepared.structure)
    v = s.inverse_slope_map @ solving.optimum(accumulate(static, ~static.uncounted, s, states, solving))
    fit = fit_forward(static, ~static.uncounted, s, states, v, solving, searched=[True] * len(states), further=levels)
    determined, decisive, longest = max(
        zip(evidence, views, recordings, strict=True), key=lambda each: (each[0].is_clear, each[2].duration_s)
    )
    drift, scale = determined.drift, decisive.prepared.structure.y_scale / s.y_scale
    if drift is not None:
        of_longest = longest.duration_s == whole.duration_s
        drift = Bounded(scale * drift.value, scale * drift.se) if of_longest else None
    creep = max((own.creep for own in evidence if own.creep), key=lambda found: found.highest, default=None)
    every = candidate_rates(fastest.sample_time, whole.duration_s)
    drives = [drive_of(one, view.prepared.skip, own) for one, view, own in zip(shown, views, evidence, strict=True)]
    return Together(
        whole,
        replace(source, static=static, prepared=InitialFit(s, 0, [SEARCHED] * len(states), fit)),
        replace(determined, creep=creep, drift=drift),
        [every[k:] for k, rate in enumerate(every) if rate >= max(determined.rates, default=math.inf)],
        levels,
        [drive.sentence(drive.creep and own.is_clear) for drive, own in zip(drives, evidence, strict=True)],
        errors,
    )


def _of_all(structures: Sequence[ModelStructure], s: ModelStructure) -> ModelStructure:
    """A structure over the output ranges of all."""
    low = min(one.y_centre - abs(one.y_scale) for one in structures)
    high = max(one.y_centre + abs(one.y_scale) for one in structures)
    return replace(s, y_centre=0.5 * (low + high), y_scale=math.copysign(0.5 * (high - low), s.y_scale))


def apart(recording: Recordings, fit: ForwardFit) -> Iterator[tuple[Recording, ForwardFit, Fit]]:
    """Each of several recordings, its share of a fit of all, and the errors of that."""
    for i, (one, samples) in enumerate(zip(recording.all, recording.members, strict=True)):
        s, dynamics = at_period(fit.structure, fit.dynamics, one.sample_time)
        own = {name: getattr(fit, name)[samples] for name in ("static", "y_model", "error", "counted")}
        own["cost"] = float(np.mean(own["error"][own["counted"]] ** 2)) + EXACT
        own["states"] = [state for owner, state in zip(recording.owners, fit.states, strict=True) if owner == i]
        alike = replace(one, y=recording.y[samples])
        errors = alike.y - s.y_centre - s.y_scale * own["y_model"]
        found = fit_of(alike, s, errors, 0, float(np.ptp(alike.y[own["counted"]])))
        yield alike, replace(fit, **own, structure=s, dynamics=dynamics, recording=alike), found
