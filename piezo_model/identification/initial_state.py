"""Estimates the operators' states before the first sample, which no recording contains, by minimising the cost (6).

The initial play states over their thresholds are a curve that starts at the first input, z(0) = x(0) with |dz/dr| ≤ 1:
the memory of the actuator's past. The initial state of a play of threshold r is visible until the drive has erased it,
H_r = min(max(z_r(0), L_r), U_r) with the running bounds L_r and U_r, so nearly every sample contributes. Creep states
start as if the actuator had rested at a level, or where the plays are. The search takes the best of a few starts
(at rest at a level, which includes coming from above, from below and demagnetised) and refines it on a grid of
halving steps, so that rounding does not decide.

The head of a recording is enough, up to where the drive has erased the initial states of the plays. First samples that
no start explains, as of an amplifier that was switched on, have an error far larger than all later ones.

Source: M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.3, for the memory curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from piezo_model.operator_state import OperatorState, padded_thresholds
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

HEAD, LONGEST_HEAD = 200_000, 500_000
"""Samples of the head, and the limit of a longer one of twice the samples that erase the initial states."""
MOVED = 0.01
"""Largest range of a resting drive, as a share of its whole range."""
TRANSIENT_SHARE = 0.1
"""Longest transient, as a share of the recording."""
FAR_MORE, NOTABLE = 4.0, 0.03
"""Smallest ratio of a transient's error to the largest later one, and its smallest error as a share of the range."""
LEVELS = tuple(np.linspace(-1.0, 1.0, 9).tolist())
COARSEST, COARSE, FINEST = 0.5, 2.0**-5, 2.0**-16
"""Steps of slopes and level in the refinement, halved down to COARSE, and to FINEST as long as the cost improves."""
TRIALS, WORK = 500, 30_000_000
"""Largest numbers of starts tried, and of samples in all trials together."""
EXACT = 1e-12
"""Cost in unit amplitudes squared at the level of rounding."""
FARTHEST = 2.0
"""Largest distance of a resting level of creep from the middle of the drive, in half ranges."""
BETTER = 0.998
"""Largest ratio of costs at which another start is taken; a simple start is kept otherwise."""


@dataclass(frozen=True)
class Start:
    """States before the first sample."""

    first: float
    """Input at the first sample, unit amplitudes."""
    slopes: tuple[float, ...]
    """dz/dr between the thresholds, from −1 to 1: all 1 after a descent from far above, all −1 after an ascent from far
    below."""
    level: float | None
    """Input in unit amplitudes at which creep had rested; None if it rested with the plays."""
    branch: float = 0.0
    """Branch on which creep had reached its level: 1 from above, −1 from below, between them after smaller swings; the
    states over the thresholds r are level + branch · r."""

    @classmethod
    def rested(cls, s: ModelStructure, first: float, at: float, branch: float = 0.0, *, creep: bool) -> Start:
        """A start at rest at ``at`` on a branch, in unit amplitudes, then driven to the first input."""
        r = s.thresholds
        z = np.clip(at + branch * r, first - r, first + r)
        return cls(first, tuple((np.diff(z) / np.diff(r)).tolist()), at if creep else None, branch)

    def state(self, s: ModelStructure, centre: float, half: float) -> OperatorState:
        """States of the operators; plays too wide for a drive of that centre and half range rest in the middle."""
        r, play = padded_thresholds(s), np.full(s.lanes, self.first)
        play[1 : s.n + 1] += np.cumsum(np.diff(s.thresholds) * np.array(self.slopes))
        settled = play if self.level is None else self.level + self.branch * r
        return OperatorState(np.where(r >= half, centre, play), np.tile(settled, len(s.creep_rates)))


def find_initial_state(
    recording: Recording,
    s: ModelStructure,
    cost: Callable[[OperatorState], float],
    refine: bool = True,
) -> tuple[OperatorState, float | None]:
    """Return the state of the smallest cost, and the input in unit amplitudes at which creep had rested, if any.

    The cost is the mean square error over the recording from this state, minimised over the other unknowns;
    ``refine`` searches around the best of the first few starts.
    """
    low, high = s.unit_input(np.array(recording.x_range))
    centre, half = float(0.5 * (low + high)), float(0.5 * (high - low))
    first = float(s.unit_input(recording.x[:1])[0])
    trials = min(TRIALS, WORK // recording.length)

    @cache
    def cost_of(start: Start) -> float:
        return cost(start.state(s, centre, half))

    def better_of(best: Start, others: list[Start]) -> Start:
        other = min(others, key=cost_of)
        return other if cost_of(best) > EXACT and cost_of(other) < BETTER * cost_of(best) else best

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
    free, step, improved = [i for i, r in enumerate(s.play_thresholds) if r < half], COARSEST, True
    while step >= COARSE or (improved and step >= FINEST):
        before, improved = None, False
        while best != before and cost_of.cache_info().misses < trials:
            before = best
            for change in (step, -step):
                for i in free:
                    slope = max(-1.0, min(1.0, best.slopes[i] + change))
                    best = better_of(best, [replace(best, slopes=(*best.slopes[:i], slope, *best.slopes[i + 1 :]))])
                if best.level is not None:
                    level = centre + half * max(-FARTHEST, min(FARTHEST, (best.level - centre) / half + change))
                    branch = max(-1.0, min(1.0, best.branch + change))
                    rotated = best.level - 0.5 * half * (branch - best.branch)  # about the middle threshold
                    best = better_of(
                        best,
                        [
                            replace(best, level=level),
                            replace(best, branch=branch),
                            replace(best, level=rotated, branch=branch),
                        ],
                    )
            improved |= best != before
        step *= 0.5
    return best.state(s, centre, half), best.level


def head_of(recording: Recording, s: ModelStructure, skip: int = 0) -> Recording:
    """The samples that estimate the initial state, not counting the first ``skip``."""
    settled = settled_from(recording, s)
    return recording.head(skip + max(HEAD, min(2 * settled, max(LONGEST_HEAD, settled + HEAD // 2))))


def settled_from(recording: Recording, s: ModelStructure) -> int:
    """Index of the first sample at which every play that the drive moves is independent of its initial state."""
    span = recording.x_range[1] - recording.x_range[0]
    return covered_from(
        recording, max((2.0 * r * s.x_scale for r in s.play_thresholds if 2.0 * r * s.x_scale < span), default=0.0)
    )


def moving_from(recording: Recording, skip: int) -> int:
    """Index of the first sample after ``skip`` at which the drive is no longer at rest; the length of the recording if
    it stays at rest."""
    return covered_from(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def covered_from(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it
    never does."""
    x = recording.x[skip:]
    covered = np.flatnonzero(np.maximum.accumulate(x) - np.minimum.accumulate(x) >= span)
    return skip + int(covered[0]) if covered.size else recording.length


def y_range(recording: Recording, skip: int) -> tuple[float, float]:
    """Range of the output after the first ``skip`` samples."""
    if skip == 0:
        return recording.y_range
    y = recording.y[skip:]
    return float(y.min()), float(y.max())


def longest_transient(head: Recording, s: ModelStructure) -> int:
    """Largest number of samples at the start that may be a transient; 0 if the drive does not move after them."""
    longest = min(settled_from(head, s), int(TRANSIENT_SHARE * head.length))
    return longest if longest and moving_from(head, longest) < head.length else 0


def transient_end(error: Vector, longest: int) -> int:
    """Number of samples in a transient of at most ``longest``, whose error, as a share of the range, is far larger than
    all later ones; 0 for none."""
    later = float(np.max(error[longest:]))
    if np.max(error[:longest], initial=0.0) <= max(FAR_MORE * later, NOTABLE):
        return 0
    return int(np.flatnonzero(error[:longest] > later)[-1]) + 1
