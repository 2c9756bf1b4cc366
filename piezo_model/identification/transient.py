"""A switch-on transient: first samples that no start explains, whose error is far larger than all later ones."""

import numpy as np

from piezo_model.recordings import Recording
from solvers.arrays import Vector

MOVED = 0.01
"""Largest range of a resting drive, as a share of its whole range."""
TRANSIENT_SHARE = 0.1
"""Longest transient, as a share of the recording."""
FAR_MORE, NOTABLE = 4.0, 0.03
"""Smallest ratio of a transient's error to the largest later one, and its smallest error as a share of the range."""
LARGER = 1.5
"""Smallest ratio of the error at the end of a transient to the largest later one."""
SPOILED = 3.0
"""Smallest ratio of the later errors of fits with and without the first samples that shows these to be a transient."""


def first_motion(recording: Recording, skip: int) -> int:
    """Index of the first sample after ``skip`` at which the drive is no longer at rest; the length of the recording if
    it stays at rest."""
    return index_after_travel(recording, MOVED * (recording.x_range[1] - recording.x_range[0]), skip)


def index_after_travel(recording: Recording, span: float, skip: int = 0) -> int:
    """Index of the first sample at which the drive has covered a span since ``skip``; the length of the recording if it
    never does."""
    x = recording.x[skip:]
    covered = np.flatnonzero(np.maximum.accumulate(x) - np.minimum.accumulate(x) >= span)
    return skip + int(covered[0]) if covered.size else recording.length


def longest_transient(recording: Recording) -> int:
    """Largest number of samples at the start that may be a transient; 0 if the drive does not move after them."""
    longest = int(TRANSIENT_SHARE * recording.parts[0].stop)
    return longest if longest and first_motion(recording, longest) < recording.length else 0


def transient(whole: Vector, later: Vector, longest: int) -> int:
    """Number of first samples that the fit of the later ones does not describe; 0 if the fit of the whole describes
    them and all others. The errors (N,) of both are shares of one range."""
    whole, later = np.abs(whole), np.abs(later)
    spoiled = float(np.max(whole[longest:])) > SPOILED * float(np.max(later[longest:]))
    return transient_end(later, longest) if spoiled or transient_end(whole, longest) else 0


def transient_end(error: Vector, longest: int) -> int:
    """Number of samples in a transient of at most ``longest``, whose error, as a share of the range, is far larger than
    all later ones; 0 for none."""
    later = float(np.max(error[longest:]))
    if np.max(error[:longest], initial=0.0) <= max(FAR_MORE * later, NOTABLE):
        return 0
    return int(np.flatnonzero(error[:longest] > LARGER * later)[-1]) + 1
