"""MDF of ASAM (versions 3 and 4) by asammdf: every group has its own time, so channels of one group go together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.tables import Channel, ChannelTable, Column, Kind, Reading, parsed

NAME = "an MDF file"
ORDER = 70
APART = True


def recognises(path: Path, head: bytes) -> bool:
    """Whether it starts as an MDF file, closed or not."""
    return head.startswith((b"MDF     ", b"UnFinMF "))


@dataclass(frozen=True)
class Slice:
    """Records of a channel."""

    path: Path
    group: int
    index: int

    def __call__(self, start: int, stop: int) -> NDArray:
        """Values from one row to before another."""
        from asammdf import MDF

        with MDF(self.path) as file:
            return np.asarray(
                file.get(
                    group=self.group,
                    index=self.index,
                    record_offset=start,
                    record_count=stop - start,
                    samples_only=True,
                )[0]
            )


def open_table(path: Path, reading: Reading) -> ChannelTable:
    """List the channels of numbers."""
    from asammdf import MDF

    channels: list[Channel] = []
    with parsed(path, "MDF"), MDF(path) as file:
        groups = [k for k, group in enumerate(file.groups) if group.channel_group.cycles_nr > 1]
        for k in groups:
            rows = file.groups[k].channel_group.cycles_nr
            for at, channel in enumerate(file.groups[k].channels):
                probe = file.get(group=k, index=at, record_offset=0, record_count=1)
                if probe.samples.dtype.kind in "iufb" and probe.samples.ndim == 1:
                    name = channel.name if len(groups) == 1 else f"{k + 1}/{channel.name}"
                    kind: Kind = "flag" if probe.samples.dtype.kind == "b" else "number"
                    channels.append(
                        Channel(
                            Column.of_path(name, probe.unit or "", rows, None, kind, nested=len(groups) > 1),
                            Slice(path, k, at),
                        )
                    )
    return ChannelTable(path, "MDF", channels)
