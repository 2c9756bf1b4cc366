"""The operators' states before the first sample, which no recording holds, found by the cost (6) itself.

The play states over their thresholds are one curve from the first input on, z(0) = x(0) with |dz/dr| ≤ 1: the memory of
what the actuator had seen. A play of threshold r shows its start until the drive has wiped it out, H_r =
min(max(z_r(0), L_r), U_r) with the running bounds L_r and U_r, so nearly every sample tells something. Creep states
start as if the actuator had rested at a level, or where the plays are. The search takes the best of a handful of starts
(at rest at a level, which includes coming from above, from below and demagnetised) and refines it on a grid of
halving steps, so that rounding does not decide.

They are found from the head of a recording, where the drive moves enough for the plays to forget them. Which first
samples no start explains, as where an amplifier was switched on, is told by an error far larger than anywhere after.

Source: M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.3, for the memory curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from piezo_model.identification.fitting import skipping
from piezo_model.operator_state import OperatorState, padded_thresholds
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

HEAD, LONGEST_HEAD = 200_000, 500_000
"""Samples that the start is found from: the first, or twice as many as it takes for the plays to forget it."""
MOVED = 0.01
"""Share of its range that a drive covers within the noise of its rest."""
TRANSIENT_SHARE = 0.1
"""Longest transient, as a share of the recording."""
FAR_MORE, NOTABLE = 4.0, 0.03
"""An error at the start is a transient's beyond so many times the largest later one, and beyond this share of the
range."""
LEVELS = tuple(np.linspace(-1.0, 1.0, 9).tolist())
COARSEST, COARSE, FINEST = 0.5, 2.0**-5, 2.0**-16
"""Steps of slopes and level in the refinement, halved down to COARSE, and on to FINEST for as long as that helps."""
TRIALS, WORK = 500, 30_000_000
"""Starts after which the search rests, and samples seen by all of them together."""
EXACT = 1e-12
"""Cost in unit amplitudes squared below which rounding decides and not the data."""
FARTHEST = 2.0
"""Half ranges of the drive from its middle at which creep may have rested."""
BETTER = 0.998
"""Share of the cost below which another start is taken, so that what the data hardly tell stays simple."""


@dataclass(frozen=True)
class Start:
    """States before the first sample."""

    first: float
    """Input at the first sample, unit amplitudes."""
    slopes: tuple[float, ...]
    """dz/dr between the thresholds, within −1 and 1: all 1 came down from far above, all −1 up from far below."""
    level: float | None
    """Input in unit amplitudes at which creep had rested; None where the plays are."""
    branch: float = 0.0
    """How creep had come to its level, as of ``OperatorState.at_rest``."""

    @classmethod
    def rested(cls, s: ModelStructure, first: float, at: float, branch: float = 0.0, *, creep: bool) -> Start:
        """At rest at ``at`` on a branch, as of ``OperatorState.at_rest``, and driven to the first input from there."""
        r = s.thresholds
        z = np.clip(at + branch * r, first - r, first + r)
        return cls(first, tuple((np.diff(z) / np.diff(r)).tolist()), at if creep else None, branch)

    def state(self, s: ModelStructure, centre: float, half: float) -> OperatorState:
        """States of the operators; plays that a drive of that centre and half range can never tell rest in the
        middle."""
        r, state = padded_thresholds(s), OperatorState.at_rest(s, self.first)
        steps = np.diff((0.0, *s.play_thresholds)) * np.array(self.slopes)
        state.play[1 : s.n + 1] = self.first + np.cumsum(steps)
        settled = state.play if self.level is None else self.level + self.branch * r
        state.creep[:] = np.tile(settled, len(s.creep_rates))
        state.play[r >= half] = centre
        return state


def find_initial_state(
    recording: Recording,
    s: ModelStructure,
    cost: Callable[[OperatorState], float],
    refine: bool = True,
) -> tuple[OperatorState, float | None]:
    """Return the start of the smallest cost, and the input in unit amplitudes at which creep had rested, if it had.

    The cost is the mean square error over the recording from these states on, with whatever else is free at its best;
    ``refine`` goes on from the best of the handful.
    """
    low, high = s.unit_input(np.array(recording.x_range))
    centre, half = float(0.5 * (low + high)), float(0.5 * (high - low))
    first = float(s.unit_input(next(recording.chunks(1))[0])[0])
    trials = min(TRIALS, WORK // recording.length)

    @cache
    def seen(start: Start) -> float:
        return cost(start.state(s, centre, half))

    def better_of(best: Start, others: list[Start]) -> Start:
        found = min(others, key=seen)
        return found if seen(best) > EXACT and seen(found) < BETTER * seen(best) else best

    levels = [centre + half * level for level in LEVELS]
    best = better_of(
        Start.rested(s, first, first, creep=False), [Start.rested(s, first, at, creep=False) for at in levels]
    )
    if s.creep_rates:
        best = better_of(
            best, [Start.rested(s, first, at, branch, creep=True) for at in levels for branch in (0.0, 1.0, -1.0)]
        )
        best = better_of(best, [replace(best, level=level) for level in levels])
    if not refine:
        return best.state(s, centre, half), best.level
    free, step, helped = [i for i, r in enumerate(s.play_thresholds) if r < half], COARSEST, True
    while step >= COARSE or (helped and step >= FINEST):
        before, helped = None, False
        while best != before and seen.cache_info().misses < trials:
            before = best
            for change in (step, -step):
                for i in free:
                    slope = max(-1.0, min(1.0, best.slopes[i] + change))
                    best = better_of(best, [replace(best, slopes=(*best.slopes[:i], slope, *best.slopes[i + 1 :]))])
                if best.level is not None:
                    level = centre + half * max(-FARTHEST, min(FARTHEST, (best.level - centre) / half + change))
                    branch = max(-1.0, min(1.0, best.branch + change))
                    turned = best.level - 0.5 * half * (branch - best.branch)  # about the middle threshold
                    best = better_of(
                        best,
                        [
                            replace(best, level=level),
                            replace(best, branch=branch),
                            replace(best, level=turned, branch=branch),
                        ],
                    )
            helped |= best != before
        step *= 0.5
    return best.state(s, centre, half), best.level


def head_of(recording: Recording, s: ModelStructure, skip: int = 0) -> Recording:
    """The samples that starts are tried on, as many after the first ``skip``, which are not counted, as without
    these."""
    settled = settled_from(recording, s)
    return recording.head(skip + max(HEAD, min(2 * settled, max(LONGEST_HEAD, settled + HEAD // 2))))


def settled_from(recording: Recording, s: ModelStructure) -> int:
    """Index of the first sample at which every play that the drive moves at all is known, whatever it started at."""
    span = recording.x_range[1] - recording.x_range[0]
    return covered_from(
        recording, max((2.0 * r * s.x_scale for r in s.play_thresholds if 2.0 * r * s.x_scale < span), default=0.0)
    )


def moving_from(recording: Recording, skip: int) -> int:
    """Index of the first sample after ``skip`` at which the drive is no longer at rest; the length of the recording if
    it stays so."""
    return covered_from(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def covered_from(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it
    never does."""
    low, high, seen = math.inf, -math.inf, 0
    for x, _ in recording.chunks():
        after = max(skip - seen, 0)
        lows, highs = (
            np.minimum.accumulate(np.minimum(x[after:], low)),
            np.maximum.accumulate(np.maximum(x[after:], high)),
        )
        covered = np.flatnonzero(highs - lows >= span)
        if covered.size:
            return seen + after + int(covered[0])
        low, high, seen = np.min(lows, initial=low), np.max(highs, initial=high), seen + x.size
    return seen


def y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output after the first ``skip`` samples."""
    if skip == 0:
        return recording.y_range
    low, high = math.inf, -math.inf
    for _, y, head in skipping(recording, skip):
        low, high = float(np.min(y[head:], initial=low)), float(np.max(y[head:], initial=high))
    return low, high


def longest_transient(head: Recording, s: ModelStructure) -> int:
    """Samples at the start within which a transient may lie; 0 where the drive does not move after them."""
    look = min(settled_from(head, s), int(TRANSIENT_SHARE * head.length))
    return look if look and moving_from(head, look) < head.length else 0


def transient_end(error: Vector, look: int) -> int:
    """First samples, at most ``look``, of which an error, as a share of the range, is far larger than anywhere after
    them; 0 for none."""
    later = float(np.max(error[look:]))
    if np.max(error[:look], initial=0.0) <= max(FAR_MORE * later, NOTABLE):
        return 0
    return int(np.flatnonzero(error[:look] > later)[-1]) + 1
