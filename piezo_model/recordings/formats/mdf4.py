"""MDF of ASAM (versions 3 and 4) by asammdf: every group has its own time, so channels of one group go together."""

from pathlib import Path

from piezo_model.recordings.tables import ArrayTable, ReadOptions, distinct, in_memory, parsed

NAME = "an MDF file"
SUBPROCESS = True


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts like an MDF file, finished or not."""
    return head.startswith((b"MDF     ", b"UnFinMF "))


def open_table(path: Path, options: ReadOptions) -> ArrayTable:
    """Read the channels of numbers."""
    from asammdf import MDF

    channels = []
    with parsed(path, "MDF"), MDF(path) as file:
        groups = [k for k, group in enumerate(file.groups) if group.channel_group.cycles_nr > 1]
        for k in groups:
            for at, channel in enumerate(file.groups[k].channels):
                signal = file.get(group=k, index=at)
                if signal.samples.ndim == 1:
                    name = channel.name if len(groups) == 1 else f"{k + 1}/{channel.name}"
                    channels.append((name, signal))
    signals = dict(zip(distinct([name for name, _ in channels]), (signal for _, signal in channels), strict=True))
    return in_memory(
        path,
        "MDF",
        {name: signal.samples for name, signal in signals.items()},
        units={name: signal.unit for name, signal in signals.items()},
        nested=len(groups) > 1,
    )
