"""Whether a drive has one frequency and one amplitude and is never held, so that creep cannot be determined from it.

Over such a drive, creep and hysteresis have the same loops: a fit distinguishes them by its noise alone, and a model
with creep is then wrong at every other speed. One loop and one ramp are the shortest such drives.

Backlash removes noise and rounding from the drive, as a play operator does, and what remains is followed over evenly
spaced levels. The times between these levels show holds, and the levels and times at which the direction changes show
amplitudes and periods.
"""

import numpy as np

from piezo_model.operators import play
from piezo_model.recordings import Recording

ONE_FREQUENCY = "One frequency: creep cannot be determined; record a step held for a minute."

OUTERMOST = 0.02
"""Share of the samples at either end of the range that may belong to a way to the start or be spoiled."""
BACKLASH, LEVEL = 0.05, 0.02
"""Width of the backlash and distance of the levels, as shares of the range."""
SPREAD = 0.15
"""Largest difference of the turning points on one side, as a share of the stroke."""
LEAD_IN = 20
"""Fewest turning points of which the first two may differ."""
PERIODS, PARTIAL = 1.7, 4.0
"""Largest ratio of the longest period to the shortest, and of the stretch before the second turning point or after the
last but one."""
SLOWEST, HOLD = 75, 30.0
"""Percentile of the times between levels, and the ratio to it from which such a time is a hold; fourteen for a sine."""
HELD_SHARE = 0.1
"""Largest share of holds in the time after the first movement."""


def has_one_frequency(recording: Recording) -> bool:
    """Whether the drive of a recording has one frequency and one amplitude and is not held.

    Examples
    --------
    >>> t = np.arange(6000) / 1000
    >>> [has_one_frequency(Recording.from_arrays(x, x, 1e-3)) for x in (np.sin(6 * t), np.sin(t * t), t > 1)]
    [True, False, False]
    """
    x = recording.x
    low, high = np.quantile(x, (OUTERMOST, 1.0 - OUTERMOST))
    if low == high:
        return False
    smooth = play(x, [0.5 * BACKLASH * (high - low)], x[:1])[0][:, 0]
    level = np.floor((smooth - low) / (LEVEL * (high - low))).astype(np.int64)
    at = np.flatnonzero(np.diff(level)) + 1  # first samples on another level
    step, waits = level[at] - level[at - 1], np.diff(at, append=x.size)
    levels = np.abs(step[1:])
    passing = np.where(levels > 1, 1.0, waits[:-1]) / levels  # a jump over several levels takes one sample
    holds = waits[waits > HOLD * np.percentile(passing, SLOWEST, method="lower")] if passing.size else waits
    if holds.sum() > HELD_SHARE * (x.size - at[0]):
        return False
    turns = np.flatnonzero(np.sign(step[1:]) != np.sign(step[:-1])) + 1
    if turns.size < 3:
        return True
    steady = level[at[turns] - 1][2 * (turns.size >= LEAD_IN) :]
    sides = steady[::2], steady[1::2]
    stroke = abs(float(np.median(sides[0]) - np.median(sides[1])))
    times = np.array([at[0], *at[turns], x.size])
    first, *periods, last = times[2:] - times[:-2]
    return bool(
        max(map(np.ptp, sides)) <= SPREAD * stroke
        and max(periods) <= PERIODS * min(periods)
        and max(first, last) <= PARTIAL * min(periods)
    )
