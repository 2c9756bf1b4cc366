"""Formats that a library reads, each by one function that returns named arrays.

NumPy: ``.npy`` is mapped into memory; pickled arrays in an ``.npz`` are not read.

HDF5 and NeXus: every dataset of numbers, unless attributes say that it must be scaled, is a column, or several, by its
path ``group/channel``. The attribute ``units`` (NeXus) or ``unit`` gives the unit, and a scalar dataset or an attribute
with the name of a sampling rate or period gives the period.

MATLAB, versions 5 to 7 by SciPy (7.3 is HDF5): a struct with fields ``Name`` (or ``label``) and ``Data`` (or
``values``), as from Simulink and dSPACE, is a channel of that name. Any other variable is a column named by its path; a
cell array gives one column for each cell.

TDMS of National Instruments, by npTDMS: channels are ``group/channel``, and a waveform has its sampling period.
"""

import logging
import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from piezo_model.recordings.array_table import Arrays
from piezo_model.recordings.stated_period import period_in, period_in_scalars
from piezo_model.recordings.table import RecordingError, check_size

ATTRIBUTES = ("Unit", "Units", "unit", "units")
"""Names of the attribute with the unit; the last one present is used."""
NAMES, VALUES, FIELD_UNITS = ("name", "label", "title"), ("data", "values", "value", "y"), ("unit", "units")
SCALES = {"scale_factor": 1.0, "add_offset": 0.0, "scale": 1.0}
"""Attributes by which the values of a dataset must be scaled (the first two of NetCDF), and values that change
nothing."""
MOST_UNITS, HEADER = 16, 1024
"""Most units of a dataset; bytes of an array in an archive in which its type is stated."""
PROPERTIES = ("unit_string", "NI_UnitDescription", "unit", "Unit")


def read_npy(path: Path) -> Arrays:
    """An array of rows and columns, or a structured array."""
    return Arrays("NumPy", {"": np.load(path, mmap_mode="r", allow_pickle=False)})


def read_npz(path: Path) -> Arrays:
    """Every array of an archive, except those of Python objects."""
    with zipfile.ZipFile(path) as zipped:
        check_size(path, sum(member.file_size for member in zipped.infolist()))
        pickled = {name.removesuffix(".npy") for name in zipped.namelist() if b"'|O'" in zipped.open(name).read(HEADER)}
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files if name not in pickled}
    form = "NumPy" + f", without {', '.join(map(repr, sorted(pickled)))}, pickled" * bool(pickled)
    return Arrays(form, arrays, periods=period_in_scalars(arrays))


def read_hdf5(path: Path) -> Arrays:
    """The datasets, which are read on request."""
    import h5py

    datasets: dict[str, Any] = {}
    file = h5py.File(path, "r")  # its datasets keep it open
    file.visititems(lambda name, item: datasets.update({_text(name): item} if isinstance(item, h5py.Dataset) else {}))
    datasets = {name: item for name, item in datasets.items() if name[0] != "#"}  # MATLAB's references
    for name, item in datasets.items():
        if item.external or item.is_virtual:  # it could show the bytes of any file on this machine
            raise RecordingError(f"{path}: {name!r} links to another file; only values stored in it are read")
    scaled = [
        name
        for name, item in datasets.items()
        if any(np.any(item.attrs.get(key, one) != one) for key, one in SCALES.items())
    ]
    # a chunk is unpacked as a whole
    check_size(path, max((math.prod(of.chunks or ()) * of.dtype.itemsize for of in datasets.values()), default=0))
    # of a record the fields whose cells have a size; many cells can refer to one long text
    arrays = {
        name: item.astype([(n, item.dtype[n]) for n in item.dtype.names if not item.dtype[n].hasobject])
        if item.dtype.hasobject
        else item
        for name, item in datasets.items()
        if max(item.shape or (0,)) > 1 and (item.dtype.names or item.dtype.kind in "iufbc")
        if item.attrs.get("MATLAB_class") != b"char" and name not in scaled
    }
    period = _stated([file, *(item.parent for item in datasets.values()), *datasets.values()], datasets)
    form = "HDF5" + f", without {', '.join(map(repr, scaled))}, to be scaled" * bool(scaled)
    return Arrays(form, arrays, {name: _unit(item) for name, item in datasets.items()}, period)


def _text(name: Any) -> str:
    """A name or a unit, which are bytes if they are not in UTF-8."""
    return name.decode(errors="replace") if isinstance(name, bytes) else str(name)


def _stated(holders: Sequence[Any], datasets: Mapping[str, Any]) -> float | None:
    """The sampling period, if attributes and scalars state exactly one."""
    scalars = [
        (key, holder.attrs[key])
        for holder in holders
        for key in holder.attrs
        if (stated := holder.attrs.get_id(key)).shape == () and stated.dtype.kind in "iuf"
    ] + [
        (f"{name.rpartition('/')[2]} [{_unit(item)}]", np.ravel(item[()])[0])
        for name, item in datasets.items()
        if item.size == 1 and item.dtype.kind in "iuf"
    ]
    return period_in(f"{name} = {float(value)!r}" for name, value in scalars)


def _unit(item: Any) -> str:
    """The unit of a dataset, if an attribute states it; an attribute may refer to one long text many times."""
    few = [
        key
        for key in ATTRIBUTES
        if key in item.attrs and 0 < math.prod(item.attrs.get_id(key).shape or ()) <= MOST_UNITS
    ]
    return _text(np.ravel(item.attrs[few[-1]])[0] if few else "")


def read_matlab(path: Path) -> Arrays:
    """Every variable."""
    from piezo_model.recordings.formats.mat_5 import read_mat_5

    variables = read_mat_5(path)
    units: dict[str, str] = {}
    arrays = dict(_matlab_arrays("", variables, units))
    return Arrays(
        "MATLAB",
        {name: array for name, array in arrays.items() if array.size > 1},
        units,
        period_in_scalars(arrays),
    )


def _matlab_arrays(path: str, value: Any, units: dict[str, str]) -> Iterator[tuple[str, np.ndarray]]:
    """Paths and arrays of all numbers in a value; their units are added to ``units``."""
    if isinstance(value, dict):
        plain = {str(key).lower(): item for key, item in value.items()}
        name, data, unit = (
            next((plain[key] for key in keys if key in plain), None) for keys in (NAMES, VALUES, FIELD_UNITS)
        )
        if isinstance(name, str) and name and data is not None:
            label = f"{path}/{name}".lstrip("/")
            units[label] = unit if isinstance(unit, str) else ""
            yield from _matlab_arrays(label, data, units)
            value = {
                key: item for key, item in value.items() if str(key).lower() not in (*NAMES, *VALUES, *FIELD_UNITS)
            }
        for key, item in value.items():
            if not str(key).startswith("__"):
                yield from _matlab_arrays(f"{path}/{key}".lstrip("/"), item, units)
    elif isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.dtype.kind == "O"):
        for k, item in enumerate(np.ravel(value) if isinstance(value, np.ndarray) else value, start=1):
            named = isinstance(item, dict) and any(
                item[key] and isinstance(item[key], str) for key in item if key.lower() in NAMES
            )
            yield from _matlab_arrays(path if named else f"{path}/{k}", item, units)
    elif np.asarray(value).dtype.kind in "iufbc":
        yield path, np.asarray(value)


def read_tdms(path: Path) -> Arrays:
    """The channels."""
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.ERROR)  # a truncated file has fewer rows
    stated = TdmsFile.read_metadata(path).groups()
    check_size(
        path, sum(len(channel) * max(channel.dtype.itemsize, 8) for group in stated for channel in group.channels())
    )
    groups = TdmsFile.read(path, raw_timestamps=True).groups()
    channels = {
        channel.name if len(groups) == 1 else f"{group.name}/{channel.name}": channel
        for group in groups
        for channel in group.channels()
    }
    return Arrays(
        "TDMS",
        {name: _exact(channel[:]) for name, channel in channels.items()},
        {
            name: next((str(channel.properties[key]) for key in PROPERTIES if channel.properties.get(key)), "")
            for name, channel in channels.items()
        },
        {
            name: step
            for name, channel in channels.items()
            if isinstance(step := channel.properties.get("wf_increment"), float) and step
        },
        {name: start for name, channel in channels.items() if (start := _start(channel.properties)) is not None},
        nested=len(groups) > 1,
    )


def _start(properties: Mapping[str, Any]) -> float | None:
    """Start of a waveform in seconds, if it is stated."""
    from nptdms.timestamp import TdmsTimestamp

    time, offset = properties.get("wf_start_time"), properties.get("wf_start_offset")
    seconds = time.seconds + time.second_fractions * 2.0**-64 if isinstance(time, TdmsTimestamp) else 0.0
    return seconds + (offset if isinstance(offset, float) else 0.0) or None


def _exact(values: Any) -> np.ndarray:
    """Times to the nanosecond; the library's own conversion truncates to microseconds."""
    if not hasattr(values, "second_fractions"):
        return np.asarray(values)
    nanoseconds = np.rint(values.second_fractions * (1e9 * 2.0**-64)).astype("m8[ns]")
    return np.asarray(values.seconds.astype("M8[s]") + nanoseconds)
