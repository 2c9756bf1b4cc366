"""First samples that no start of the operators explains, as where an amplifier was switched on."""

from __future__ import annotations

import numpy as np

from piezo_model.identification.travel import moving_from, settled_from
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

TRANSIENT_SHARE = 0.1
"""Longest transient, as a share of the recording."""
FAR_MORE, NOTABLE = 4.0, 0.03
"""An error at the start is a transient's beyond so many times the largest later one, and beyond this share of the
range."""


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
