"""One table in every supported format, read to the last bit; damaged and foreign files are refused."""

import gc
import pickle
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from command_line import python
from recording_files import N, X, Y, refusal, text_file, workbook

from piezo_model.recordings import Recording, formats
from piezo_model.recordings.array_table import Arrays

PERIOD = 5e-4
T = np.arange(N) * PERIOD


def gcs(path: Path, separator: str = " ", end: str = " \n") -> None:
    path.write_text(
        f"# REM Sine\n# VERSION = 1 \n# TYPE = 1 \n# SEPARATOR = {ord(separator)} \n# DIM = 2 \n"
        "# SAMPLE_TIME = 0.000500 \n"
        f"# NDATA = {N} \n# NAME0 = Open-loop Control Value of axis 1 \n# NAME1 = Current Position of axis 1 \n"
        "# \n# END_HEADER \n"
        + "".join(f"{x!r}{separator}{y!r}{end}" for x, y in zip(X.tolist(), Y.tolist(), strict=True))
    )


def hdf5(
    values: dict[Any, Any], of: dict[str, dict[str, Any]] | None = None, **attributes: float
) -> Callable[[Path], None]:
    """Writer of a file of datasets, some with attributes of their own, and attributes of the file."""

    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name, value in values.items():
                file[name] = value
            for name, own in (of or {}).items():
                file[name].attrs.update(own)
            file.attrs.update(attributes)

    return write


nexus = hdf5(
    {
        "entry/data/time": T,
        "entry/data/voltage": X,
        "entry/data/displacement": Y,
        "entry/log/temperature": np.arange(17.0),
        "entry/title": "a sine",
    },
    {
        "entry/data/time": {"units": "s"},
        "entry/data/voltage": {"units": "V"},
        "entry/data/displacement": {"units": "µm"},
    },
)


def hdf5_compound(path: Path) -> None:
    """With a text in each row."""
    record = np.empty(N, [("time", "f8"), ("voltage_V", "f8"), ("y_um", "f8"), ("note", h5py.string_dtype())])
    record["time"], record["voltage_V"], record["y_um"], record["note"] = T, X, Y, "well"
    with h5py.File(path, "w") as file:
        file.create_dataset("record", data=record, chunks=(100,), compression="gzip")


def tdms(*segments: list[nptdms.ChannelObject]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with nptdms.TdmsWriter(path) as writer:
            for segment in segments:
                writer.write_segment(segment)

    return write


tdms_waveform = tdms(
    *(
        [
            nptdms.ChannelObject("Stage", name, values[part], properties={"wf_increment": PERIOD, "unit_string": unit})
            for name, values, unit in (("Drive", X, "V"), ("Sensor", Y, "µm"))
        ]
        for part in np.array_split(np.arange(N), 3)
    )
)
tdms_groups = tdms(
    [
        nptdms.ChannelObject("Stage", "Time", T),
        nptdms.ChannelObject("Stage", "AO0", X),
        nptdms.ChannelObject("Stage", "AI0", Y),
        nptdms.ChannelObject("Log", "temperature", np.arange(5.0)),
    ]
)


def mat_struct(path: Path) -> None:
    channels = {"Name": "Piezo voltage", "Data": X, "Unit": "V"}, {"Name": "Position sensor", "Data": Y, "Unit": "um"}
    scipy.io.savemat(
        path, {"recorded": {"X": {"Name": "time", "Data": T}, "Y": np.array(channels, object), "Description": "stage"}}
    )


def mat_7_3(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", T), ("u", X), ("y", Y)):
            file[name] = values.reshape(1, -1)
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["#refs#/a"], file["#refs#/b"] = T[:3], T[:5]  # a cell array of unlike lengths
        file["notes"] = np.array([file[f"#refs#/{name}"].ref for name in "ab"], h5py.ref_dtype)
        file["notes"].attrs["MATLAB_class"] = np.bytes_("cell")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(head + path.read_bytes()[len(head) :])


def excel(path: Path) -> None:
    """With another table beside the recording, on the second sheet."""
    book = workbook(path, ["nothing here"])
    sheet, rows = book.create_sheet("Messung 1"), zip(T.tolist(), X.tolist(), Y.tolist(), strict=True)
    heads = ["Operator", "K"], [], ["f", "gain", None, "Zeit", "Spannung", "Weg"], [None, None, None, "s", "V", "µm"]
    for row in (*heads, *([k, y, None, t, x, y] for k, (t, x, y) in enumerate(rows)), ["Ende"]):
        sheet.append(row)
    book.save(path)


def numpy_file(save: Callable[..., None], *arrays: Any, **named: Any) -> Callable[[Path], None]:
    """NumPy adds a suffix to a name and none to a file."""

    def write(path: Path) -> None:
        with path.open("wb") as file:
            save(file, *arrays, **named)

    return write


STAMPS = np.datetime64("2024-01-31T23:59:59.9999", "ns") + 500 * np.arange(N).astype("m8[ns]")
"""At 2 MHz, over midnight."""


def parquet_stamps(path: Path, times: pa.Array) -> None:
    pq.write_table(pa.table({"t": times, "u": X, "y": Y}), path)


def tdms_stamps(path: Path) -> None:
    """With times in 2⁻⁶⁴ s, as the format has them; npTDMS writes whole microseconds."""
    written = nptdms.types.TimeStamp.to_array_bytes(STAMPS)
    tdms([nptdms.ChannelObject("Stage", name, values) for name, values in (("t", STAMPS), ("u", X), ("y", Y))])(path)
    since = STAMPS - np.datetime64("1904-01-01", "ns")
    seconds, fractions = since // np.timedelta64(1, "s"), (since % np.timedelta64(1, "s")).astype(np.int64)
    exact = np.array(
        [((int(part) << 64) // 10**9, second) for second, part in zip(seconds, fractions, strict=True)], dtype="<u8,<i8"
    )
    content = path.read_bytes()
    assert content.count(written) == 1
    path.write_bytes(content.replace(written, exact.tobytes()))


TIMES: dict[str, Callable[[Path], Any]] = {
    "Parquet": lambda path: parquet_stamps(path, pa.array(STAMPS)),
    "Parquet with a time zone": lambda path: parquet_stamps(
        path, pa.array(STAMPS).cast(pa.timestamp("ns", "Europe/Berlin"))
    ),
    "Parquet of durations": lambda path: parquet_stamps(
        path, pa.array(STAMPS - STAMPS[0] + np.timedelta64(10**9, "s"))
    ),
    "Parquet of times of day": lambda path: parquet_stamps(path, pa.array(STAMPS).cast(pa.time64("ns"))),
    "NPY": numpy_file(np.save, np.rec.fromarrays([STAMPS, X, Y], names="t,u,y")),
    "NPZ": numpy_file(np.savez, t=STAMPS, u=X, y=Y),
    "NPZ of durations": numpy_file(np.savez, t=STAMPS - STAMPS[0], u=X, y=Y),
    "TDMS": tdms_stamps,
}


FORMATS: dict[str, tuple[Callable[[Path], Any], dict[str, str]]] = {
    "GCS": (gcs, {"input": "Open-loop Control Value of axis 1", "output": "Current Position of axis 1"}),
    "GCS with tabs": (
        lambda path: gcs(path, separator="\t", end="\n"),
        {"input": "Open-loop Control Value of axis 1", "output": "Current Position of axis 1"},
    ),
    "NeXus": (nexus, {"time": "entry/data/time", "input": "entry/data/voltage", "output": "entry/data/displacement"}),
    "HDF5 matrix": (hdf5({"data": np.stack([X, Y]), "fs": 1 / PERIOD}), {"input": "data/1", "output": "data/2"}),
    "HDF5 compound": (hdf5_compound, {"time": "record/time", "input": "record/voltage_V", "output": "record/y_um"}),
    "HDF5 in Latin-1": (
        hdf5({b"Spannung_V": X, "Höhe_um".encode("latin-1"): Y, "fs": 1 / PERIOD}),
        {"input": "Spannung_V", "output": "H\ufffdhe_um"},
    ),
    "HDF5 attribute": (hdf5({"u": X, "y": Y}, sample_rate_Hz=1 / PERIOD), {"input": "u", "output": "y"}),
    "MAT 5": (
        lambda path: scipy.io.savemat(path, {"t": T, "u": X, "y": Y}),
        {"time": "t", "input": "u", "output": "y"},
    ),
    "MAT 5 matrix": (
        lambda path: scipy.io.savemat(path, {"data": np.stack([X, Y], 1), "Ts": PERIOD}),
        {"input": "data/1", "output": "data/2"},
    ),
    "MAT 5 struct": (
        mat_struct,
        {"time": "recorded/X/time", "input": "recorded/Y/Piezo voltage", "output": "recorded/Y/Position sensor"},
    ),
    "MAT 5 cells": (
        lambda path: scipy.io.savemat(path, {"log": np.array([T, X, Y, T[:3]], object)}),
        {"time": "log/1", "input": "log/2", "output": "log/3"},
    ),
    "MAT 5 beside a large sparse matrix": (
        lambda path: scipy.io.savemat(path, {"t": T, "u": X, "y": Y, "grid": scipy.sparse.eye_array(10**5, k=9)}),
        {"time": "t", "input": "u", "output": "y"},
    ),
    "MAT 7.3": (mat_7_3, {"time": "t", "input": "u", "output": "y"}),
    "NPY": (
        numpy_file(np.save, np.stack([T, X, Y], 1)),
        {"time": "column 1", "input": "column 2", "output": "column 3"},
    ),
    "NPY of fields": (
        numpy_file(np.save, np.rec.fromarrays([Y, X, T], names="y_um,voltage_V,t")),
        {"time": "t", "input": "voltage_V", "output": "y_um"},
    ),
    "NPZ": (numpy_file(np.savez, u=X, y=Y, dt=PERIOD, made=np.array({"by": "K"})), {"input": "u", "output": "y"}),
    "Parquet of decimals": (
        lambda path: pq.write_table(
            pa.table({"t": T, **{name: pa.array(of).cast(pa.decimal128(12, 6)) for name, of in (("u", X), ("y", Y))}}),
            path,
        ),
        {"time": "t", "input": "u", "output": "y"},
    ),
    "Excel": (excel, {"time": "Zeit", "input": "Spannung", "output": "Weg"}),
    "Excel of texts": (
        lambda path: workbook(
            path, ["t", "u", "y"], *([f"{v:.6f}".replace(".", ",") for v in row] for row in zip(T, X, Y, strict=True))
        ),
        {"time": "t", "input": "u", "output": "y"},
    ),
    "TDMS waveform": (tdms_waveform, {"input": "Drive", "output": "Sensor"}),
    "TDMS groups": (tdms_groups, {"time": "Stage/Time", "input": "Stage/AO0", "output": "Stage/AI0"}),
}


def made(folder: Path, name: str) -> Path:
    """A file of the format with a neutral suffix."""
    path = folder / f"{name}.rec"
    FORMATS[name][0](path)
    return path


@pytest.mark.parametrize(
    ("late", "refused"),
    [
        ({"wf_start_time": np.datetime64("2026-01-31T12:00:00.010", "us")}, True),
        ({"wf_start_offset": 0.01}, True),
        ({"wf_start_offset": PERIOD / 4}, False),
    ],
)
def test_waveforms_that_start_apart_are_not_paired_row_by_row(
    tmp_path: Path, late: dict[str, Any], refused: bool
) -> None:
    begin = {
        "wf_start_time": np.datetime64("2026-01-31T12:00:00", "us"),
        "wf_start_offset": 0.0,
        "wf_increment": PERIOD,
    }
    starts = {"Drive": begin, "Sensor": {**begin, **late}}
    tdms(
        [
            nptdms.ChannelObject("Stage", name, values, properties=starts[name])
            for name, values in (("Drive", X), ("Sensor", Y))
        ]
    )(path := tmp_path / "stage.tdms")
    if refused:
        assert "'Drive' and 'Sensor' start 0.01 s apart" in refusal(path)
    else:
        np.testing.assert_array_equal(Recording.open(path).y, Y)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_clean_arrays_and_the_units_that_it_keeps(tmp_path: Path, name: str) -> None:
    columns, unnamed = FORMATS[name][1], ("HDF5 matrix", "MAT 5 matrix", "MAT 5 cells", "NPY")
    named = {role: columns[role] for role in ("input", "output") if name in unnamed}
    recording = pickle.loads(pickle.dumps(Recording.open(made(tmp_path, name), **named)))
    found = np.array([recording.x, recording.counted_y])
    # files of Excel keep sixteen digits
    np.testing.assert_array_equal(np.round(found, 9) if name.startswith("Excel") else found, [X, Y])
    assert (recording.sample_time, recording.columns) == (pytest.approx(PERIOD, rel=1e-12), columns)
    if name in ("NeXus", "Excel", "TDMS waveform", "MAT 5 struct"):
        assert (recording.input_unit, recording.output_unit, "µm" in recording.describe()) == ("V", "um", True)


def test_a_damaged_file_of_any_format_is_refused(tmp_path: Path) -> None:
    for name in FORMATS:
        path = made(tmp_path, name)
        content = path.read_bytes()
        path.write_bytes(content.replace(b"0", b"x") if "GCS" in name else content[: len(content) * 2 // 5])
        try:
            recording = Recording.open(path)
        except ValueError:
            refusal(path)
        else:  # the remaining part may be a valid file, e.g. of whole TDMS segments
            assert recording.length < N, name
            np.testing.assert_array_equal(recording.x, X[: recording.length])
    gc.collect()  # a file that was left open is an error


def test_channels_are_named_by_path_by_name_or_by_number(tmp_path: Path) -> None:
    path = made(tmp_path, "NeXus")
    for x in ("entry/data/voltage", "voltage", "3"):
        np.testing.assert_array_equal(Recording.open(path, input=x).x, X)
    assert "has no column 'volts' for the input; its columns are 'entry/data/displacement'" in refusal(
        path, input="volts"
    )
    assert "columns differ in length: 'entry/log/temperature' has 17 rows" in refusal(
        path, time="temperature", input="voltage", output="displacement"
    )


@pytest.mark.parametrize(
    ("form", "option", "value"), [("Excel", "decimal", ","), ("NeXus", "table", "Messung 1"), ("NPZ", "header_row", 2)]
)
def test_an_option_that_a_format_does_not_support_is_refused(
    tmp_path: Path, form: str, option: str, value: object
) -> None:
    assert f"which takes no {option.replace('_', ' ')}" in refusal(made(tmp_path, form), **{option: value})


READ_EACH = """
import sys
from piezo_model.recordings import Recording, RecordingError
for path in sys.argv[1:]:
    try:
        print(Recording.open(path))
    except RecordingError as error:
        print(error)
"""


def test_a_missing_library_is_a_sentence_that_says_what_to_install(tmp_path: Path) -> None:
    packages = {"NeXus": "h5py", "Excel": "openpyxl", "TDMS groups": "nptdms"}
    paths = [made(tmp_path, name).rename(tmp_path / package) for name, package in packages.items()]
    (tmp_path / "absent").mkdir()
    for package in packages.values():
        text_file(tmp_path / "absent", f"raise ModuleNotFoundError(name={package!r})", name=f"{package}.py")
    sentences = python("-c", READ_EACH, *paths, first=tmp_path / "absent").stdout.splitlines()
    for path, sentence in zip(paths, sentences, strict=True):
        assert sentence.startswith(f"{path}: is ")
        assert f"reading it needs the package {path.name}: install piezobench[formats]" in sentence


def test_a_format_is_one_function_and_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def read_doubles(path: Path) -> Arrays:
        data = np.frombuffer(path.read_bytes()[8:]).reshape(-1, 2)
        return Arrays("doubles", {"u": data[:, 0], "y": data[:, 1]}, periods=0.01)

    added = formats.Format("doubles", formats.begins(b"DBL1"), read_doubles)
    monkeypatch.setattr(formats, "FORMATS", (added, *formats.FORMATS))
    (tmp_path / "stage.bin").write_bytes(b"DBL1\0\0\0\0" + np.stack([X, Y], 1).tobytes())
    assert (
        "doubles, which states the sampling period; 1300 samples over 12.99 s, one every 10 ms"
        in Recording.open(tmp_path / "stage.bin").describe()
    )


def test_a_file_that_was_read_can_be_written_again(tmp_path: Path) -> None:
    for values in (Y, 2.0 * Y):
        hdf5({"t": T, "u": X, "y": values})(tmp_path / "stage.h5")
        recording = Recording.open(tmp_path / "stage.h5", input="u", output="y")
        assert recording.y_range == (values.min(), values.max())


@pytest.mark.parametrize(
    ("write", "options", "sentence"),
    [
        (
            lambda path: pq.write_table(pa.table({name: pa.array([], pa.float64()) for name in "tuy"}), path),
            {},
            "has no data rows",
        ),
        *(
            (
                lambda path, u=u: pq.write_table(pa.table({"t": [0, 1, 2], "u": u, "y": [1.0, 2.0, 4.0]}), path),
                options,
                sentence,
            )
            for u, options, sentence in (
                ([1, None, 3], {}, "column 'u' is missing in data row 2"),
                (["1", "2", "3"], {}, "cannot tell which column is the input"),
                (["1", "2", "3"], {"input": "u"}, "column 'u' holds values of type"),
                ([True, False, True], {}, "cannot tell which column is the input"),
                ([True, False, True], {"input": "u"}, "column 'u' holds values of type"),
            )
        ),
        (
            lambda path: path.write_bytes(b"MDF     4.10    amdf8829\0\0\0\0\x9a\x01".ljust(4096, b"\0")),
            {},
            "is none of these: a Parquet file, a stream of Arrow batches, a NumPy file, an archive of NumPy, an Excel",
        ),
        *(
            (
                hdf5({"t": T, "u": X, "y": np.round(1e3 * Y)}, {"u": {scale: 1.0}, "y": {scale: 1e-3}}),
                {},
                "cannot tell which column is the output; its columns are 't', 'u'; name it with --output",
            )
            for scale in ("scale_factor", "scale")
        ),
        (
            hdf5({"t": T, "u": X, "y": Y[: N // 2]}),
            {},
            f"which column is the output; its columns are 't', 'u', 'y' of {N // 2} rows; name it with --output",
        ),
        *(
            (
                lambda path, make=make: make(path, cube=np.zeros((4, 5, 6)), spectrum=X + 1j * Y),
                {},
                f"it holds 'cube' (4 x 5 x 6, float64), 'spectrum' ({N}, complex128); save real arrays",
            )
            for make in (
                lambda path, **arrays: numpy_file(np.savez, **arrays)(path),
                lambda path, **arrays: hdf5(arrays)(path),
                lambda path, **arrays: scipy.io.savemat(path, arrays, appendmat=False),
            )
        ),
        (
            tdms(
                [
                    nptdms.ChannelObject("Stage", name, values, properties={"wf_increment": period})
                    for name, values, period in (("Drive", X, PERIOD), ("Sensor", Y, 2 * PERIOD))
                ]
            ),
            {},
            "'Drive' and 'Sensor' are sampled every 0.0005 and 0.001 s; resample one of them",
        ),
        (
            lambda path: (hdf5_compound(path), path.write_bytes(path.read_bytes().replace(b"x^", b"  "))),
            {},
            "is HDF5, and damaged: Can't synchronously read data",
        ),
        *(
            (lambda path, text=text: path.write_text(text), {}, "is JSON, as models are, and no table of rows")
            for text in ('{\n "start": [\n  1.0,\n  2.0\n ]\n}\n', "[[0, 1, 2],\n[1, 2, 3],\n[2, 3, 5]]")
        ),
    ],
    ids=range(17),
)
def test_a_file_without_columns_or_rows_of_numbers_is_refused_with_what_it_holds_or_what_is_read(
    tmp_path: Path, write: Callable[[Path], object], options: dict[str, str], sentence: str
) -> None:
    write(tmp_path / "stage.bin")
    assert sentence in refusal(tmp_path / "stage.bin", **options)


def test_a_mistake_in_a_reader_is_not_called_a_damaged_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("piezo_model.recordings.formats.libraries.PROPERTIES", None)
    with pytest.raises(TypeError):
        Recording.open(made(tmp_path, "TDMS waveform"))


@pytest.mark.parametrize("name", TIMES)
def test_times_are_read_to_the_nanosecond(tmp_path: Path, name: str) -> None:
    TIMES[name](tmp_path / "stage.rec")
    recording = Recording.open(tmp_path / "stage.rec")
    assert (recording.sample_time, recording.columns["time"]) == (5e-7, "t")
    np.testing.assert_array_equal([recording.x, recording.y], [X, Y])


@pytest.mark.parametrize(
    ("over", "shown"),
    [(1.0, "hh:mm:ss.000"), (2.0, "hh:mm:ss.000"), (2.0, "[h]:mm:ss.000"), (45000.0, "yyyy-mm-dd hh:mm:ss.000")],
)
def test_a_workbook_past_midnight_is_read(tmp_path: Path, over: float, shown: str) -> None:
    """In Excel a time is a number of days; one without date is shown as a time of day before the first midnight and as
    a date after it."""
    days = (over - (2 - np.arange(400) / 100) / 86400) % (1.0 if over == 2.0 and shown[0] == "h" else np.inf)
    book = workbook(tmp_path / "stage.xlsx", ["t", "voltage_V", "height_um"], *zip(days, X, Y, strict=False))
    for row in range(2, 402):
        book.active.cell(row, 1).number_format = shown
    book.save(tmp_path / "stage.xlsx")
    recording = Recording.open(tmp_path / "stage.xlsx")
    assert (recording.sample_time, recording.columns["time"]) == (0.01, "t")


@pytest.mark.parametrize(
    ("cell", "shown"), [("over", "'over'"), (datetime(2024, 1, 31), "'2024-01-31T00:00:00.000000'")]
)
def test_a_cell_that_is_not_a_number_is_named_with_row_and_sheet(tmp_path: Path, cell: object, shown: str) -> None:
    cells = ([k / 10, cell if k == 5 else k % 7, k % 5] for k in range(50))
    workbook(tmp_path / "stage.xlsx", ["t", "voltage_V", "height_um"], *cells)
    sentence = f"column 'voltage_V' holds {shown} in row 7 of sheet 'Sheet' (data row 6), where a number is needed"
    assert sentence in refusal(tmp_path / "stage.xlsx")
