"""Several recordings of one stage as one, each with its own sampling period."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Self

import numpy as np

from piezo_model.recordings.recording import Recording
from solvers.arrays import Vector


@dataclass(frozen=True, kw_only=True)
class Recordings(Recording):
    """Recordings one after another, in the same units; the sampling period is the shortest one."""

    recordings: tuple[Recording, ...] = field(repr=False, compare=False)
    weights: tuple[float, ...]
    """Weight of each recording in a mean over all samples."""

    @classmethod
    def concatenate(cls, recordings: Sequence[Recording], weights: Sequence[float] | None = None) -> Self:
        """Concatenate recordings in the same units; with equal weights by default."""
        first = recordings[0]
        ends = np.cumsum([0, *(recording.length for recording in recordings)])
        x_ends, y_ends = zip(*((recording.x_range, recording.y_range) for recording in recordings), strict=True)
        return cls(
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

    @property
    def duration_s(self) -> float:
        """Duration of the longest recording in s."""
        return max(recording.duration_s for recording in self.recordings)

    @property
    def time(self) -> Vector:
        """Time since the middle of each recording, shape (samples,), from −1 to 1 over the longest one."""
        return np.concatenate(
            [recording.time * (recording.duration_s / self.duration_s) for recording in self.recordings]
        )

    @property
    def members(self) -> list[slice]:
        """The samples of each recording."""
        ends = np.cumsum([0, *(recording.length for recording in self.recordings)]).tolist()
        return [slice(*pair) for pair in pairwise(ends)]

    @property
    def owners(self) -> list[int]:
        """Number of the recording to which each part belongs."""
        return [i for i, recording in enumerate(self.recordings) for _ in recording.starts]

    @property
    def part_weights(self) -> list[float]:
        """Weight of each part in a mean over the samples."""
        return [self.weights[i] for i in self.owners]

    @property
    def periods(self) -> list[float]:
        """Sampling period of each part in s."""
        return [self.recordings[i].sample_time for i in self.owners]
