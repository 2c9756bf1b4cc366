"""TDMS of National Instruments by npTDMS: channels are ``group/channel``, and a waveform knows its sampling period."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.tables import Channel, ChannelTable, Column, Kind, Reading, parsed

NAME = "a TDMS file"
ORDER = 60
APART = True
UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")


def recognises(path: Path, head: bytes) -> bool:
    """Whether it starts as a TDMS file."""
    return head.startswith(b"TDSm")


@dataclass(frozen=True)
class Slice:
    """Rows of a channel."""

    path: Path
    group: str
    channel: str

    def __call__(self, start: int, stop: int) -> NDArray:
        """Values from one row to before another."""
        from nptdms import TdmsFile
        from nptdms.timestamp import TimestampArray

        with TdmsFile.open(self.path, raw_timestamps=True) as file:
            values = file[self.group][self.channel][start:stop]
        if isinstance(values, TimestampArray):  # its own conversion cuts off what is less than a microsecond
            nanoseconds = np.rint(values.second_fractions * (1e9 * 2.0**-64)).astype("m8[ns]")
            return np.asarray(values.seconds.astype("M8[s]") + nanoseconds)
        return np.asarray(values)


def open_table(path: Path, reading: Reading) -> ChannelTable:
    """List the channels."""
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.ERROR)  # that a file was cut off shows in its rows
    with parsed(path, "TDMS"), TdmsFile.open(path) as file:
        listed = [channel for group in file.groups() for channel in group.channels()]
        single = len(file.groups()) == 1
        channels = [
            Channel(_column(channel, single), Slice(path, channel.group_name, channel.name))
            for channel in listed
            if len(channel) > 1
        ]
    return ChannelTable(path, "TDMS", channels)


def _column(channel: Any, single: bool) -> Column:
    name = channel.name if single else f"{channel.group_name}/{channel.name}"
    unit = next((str(channel.properties[key]) for key in UNITS if channel.properties.get(key)), "")
    kind: Kind = {"M": "clock", "b": "flag"}.get(np.dtype(channel.dtype).kind, "number")  # type: ignore[assignment]
    if np.dtype(channel.dtype).kind in "OSU":
        kind = "text"
    increment = float(channel.properties.get("wf_increment", 0.0))
    return Column.of_path(name, unit, len(channel), increment or None, kind, nested=not single)
