"""TDMS of National Instruments by npTDMS: channels are ``group/channel``, and a waveform knows its sampling period."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.tables import ArrayTable, ReadOptions, in_memory, parsed

NAME = "a TDMS file"
APART = True
UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")


def recognises(path: Path, head: bytes) -> bool:
    """Whether it starts as a TDMS file."""
    return head.startswith(b"TDSm")


def open_table(path: Path, reading: ReadOptions) -> ArrayTable:
    """Read the channels."""
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.ERROR)  # that a file was cut off shows in its rows
    with parsed(path, "TDMS"):
        groups = TdmsFile.read(path, raw_timestamps=True).groups()
        channels = {
            channel.name if len(groups) == 1 else f"{group.name}/{channel.name}": channel
            for group in groups
            for channel in group.channels()
        }
        arrays = {name: _exact(channel[:]) for name, channel in channels.items()}
    units, periods = {}, {}
    for name, channel in channels.items():
        units[name] = next((str(channel.properties[key]) for key in UNITS if channel.properties.get(key)), "")
        periods[name] = float(channel.properties.get("wf_increment", 0.0)) or None
    return in_memory(path, "TDMS", arrays, units, periods, nested=len(groups) > 1)


def _exact(values: Any) -> NDArray:
    """Times to the nanosecond: the library's own conversion cuts off what is less than a microsecond."""
    if not hasattr(values, "second_fractions"):
        return np.asarray(values)
    nanoseconds = np.rint(values.second_fractions * (1e9 * 2.0**-64)).astype("m8[ns]")
    return np.asarray(values.seconds.astype("M8[s]") + nanoseconds)
