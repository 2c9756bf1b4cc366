"""Several recordings of one stage as one, of which each keeps its sampling period."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
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
    def together(cls, recordings: Sequence[Recording], weights: Sequence[float] | None = None) -> Self:
        """Put recordings in the same units together; equal weights by default."""
        first = recordings[0]
        ends = np.cumsum([0, *(one.length for one in recordings)])
        x_ends, y_ends = zip(*((one.x_range, one.y_range) for one in recordings), strict=True)
        return cls(
            name=" and ".join(one.name for one in recordings),
            sample_time=min(one.sample_time for one in recordings),
            remarks=tuple(f"{one.name}: {note}" for one in recordings for note in one.notes),
            units=" ".join(filter(None, (one.units for one in recordings))),
            x=np.concatenate([one.x for one in recordings]),
            y=np.concatenate([one.y for one in recordings]),
            uncounted=np.concatenate([one.uncounted for one in recordings]),
            starts=tuple(int(end) + start for end, one in zip(ends, recordings, strict=False) for start in one.starts),
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
        return max(one.duration_s for one in self.recordings)

    @property
    def time(self) -> Vector:
        """Time, shape (samples,), from the middle of each recording on, from −1 to 1 over the longest one."""
        return np.concatenate([one.time * (one.duration_s / self.duration_s) for one in self.recordings])

    @property
    def members(self) -> list[slice]:
        """The samples of each recording."""
        ends = np.cumsum([0, *(one.length for one in self.recordings)]).tolist()
        return [slice(*pair) for pair in pairwise(ends)]

    @property
    def owners(self) -> list[int]:
        """For each part the number of its recording."""
        return [i for i, one in enumerate(self.recordings) for _ in one.starts]

    @property
    def part_weights(self) -> list[float]:
        """Weight of each part in a mean over the samples."""
        return [self.weights[i] for i in self.owners]

    @property
    def periods(self) -> list[float]:
        """Sampling period of each part in s."""
        return [self.recordings[i].sample_time for i in self.owners]

    def sweeps(self) -> Iterator[Recording]:
        """The parts, one by one, each with its sampling period and the drive's range of all."""
        for i, samples in zip(self.owners, self.parts, strict=False):
            part = self.part(samples)
            yield replace(
                self.recordings[i], x=part.x, y=part.y, uncounted=part.uncounted, starts=(0,), x_range=self.x_range
            )
