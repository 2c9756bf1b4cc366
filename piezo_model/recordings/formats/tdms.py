"""TDMS of National Instruments by npTDMS: channels are ``group/channel``, and a waveform has its sampling period."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.tables import ArrayTable, ReadOptions, in_memory, parsed

NAME = "a TDMS file"
SUBPROCESS = True
UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")


def recognises(path: Path, head: bytes) -> bool:
    """Whether the file starts like a TDMS file."""
    return head.startswith(b"TDSm")


def open_table(path: Path, options: ReadOptions) -> ArrayTable:
    """Read the channels."""
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.ERROR)  # a truncated file has fewer rows
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
    return in_memory(path, "TDMS", arrays, units=units, sample_time=periods, nested=len(groups) > 1)


def _exact(values: Any) -> NDArray:
    """Times to the nanosecond; the library's own conversion truncates to microseconds."""
    if not hasattr(values, "second_fractions"):
        return np.asarray(values)
    nanoseconds = np.rint(values.second_fractions * (1e9 * 2.0**-64)).astype("m8[ns]")
    return np.asarray(values.seconds.astype("M8[s]") + nanoseconds)
