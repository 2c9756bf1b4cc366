"""A file that states more values than a recording has is refused before they are read, in little memory."""

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pytest
from command_line import python
from recording_files import N, X, Y, workbook
from test_recording_formats import FORMATS, PERIOD, T, hdf5, made, tdms

from piezo_model.recordings import Recording, RecordingError

HUGE = 10**12


def empty_hdf5(*, chunks: Any = True, maxshape: Any = None, **shapes: Any) -> Callable[[Path], None]:
    """Compressed datasets without any chunk."""

    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name, shape in shapes.items():
                file.create_dataset(name, shape, "f8", compression="gzip", chunks=chunks, maxshape=maxshape)

    return write


def element(kind: int, data: bytes, length: int | None = None) -> bytes:
    """An element of a MATLAB file, with another length than it has."""
    return struct.pack("<II", kind, len(data) if length is None else length) + data + bytes(-len(data) % 8)


def array(kind: int, shape: tuple[int, int], *inside: bytes) -> bytes:
    """An array of a class, anonymous as in a cell."""
    parts = (element(6, struct.pack("<II", kind, 0)), element(5, struct.pack("<2i", *shape)), element(1, b""), *inside)
    return element(14, b"".join(parts))


CELL, STRUCT, CHAR, DOUBLE = 1, 2, 4, 6


def mat_5(*variables: bytes) -> Callable[[Path], Any]:
    return lambda path: path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(variables))


def zeros_bomb(shape: tuple[int, int]) -> bytes:
    """A compressed array of 300 MB of zeros, whatever shape it states."""
    return element(15, zlib.compress(element(14, array(DOUBLE, shape)[8:] + element(9, bytes(300_000_000))), 1))


def npz_stated(path: Path) -> None:
    """An archive whose list of members states three gigabytes."""
    np.savez(path.with_suffix(".npz"), u=X)
    content = path.with_suffix(".npz").read_bytes()
    at = content.index(b"PK\x01\x02") + 24
    path.write_bytes(content[:at] + struct.pack("<I", 3 << 30) + content[at + 4 :])


def npz_array(path: Path) -> None:
    """An array whose own header states petabytes."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("u.npy", header.getvalue() + bytes(800))


def tdms_texts(path: Path) -> None:
    """A channel of two texts that states 2⁵⁰."""
    tdms([nptdms.ChannelObject("Stage", "note", ["ab", "cd"])])(path)
    content, index = path.read_bytes(), struct.pack("<IIQ", 0x20, 1, 2)
    assert content.count(index) == 1
    path.write_bytes(content.replace(index, struct.pack("<IIQ", 0x20, 1, 2**50)))


def long_text(path: Path) -> None:
    """A text that many cells refer to."""
    workbook(book := io.BytesIO())
    kind = "application/vnd.openxmlformats-officedocument.spreadsheetml.sharedStrings+xml"
    part = f'<Override PartName="/xl/sharedStrings.xml" ContentType="{kind}"/></Types>'
    row = "<sheetData><row>" + '<c t="s"><v>0</v></c>' * 16384 + "</row></sheetData>"
    with zipfile.ZipFile(book) as before, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as changed:
        for name in before.namelist():
            content = before.read(name).decode().replace("</Types>", part)
            changed.writestr(name, re.sub("<sheetData ?/>|<sheetData></sheetData>", row, content))
        space = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
        changed.writestr("xl/sharedStrings.xml", f'<sst xmlns="{space}"><si><t>{"x" * 10**5}</t></si></sst>')


MORE = "bytes; at most 268,435,456 are read"
HOSTILE: dict[str, tuple[Callable[[Path], Any], str]] = {
    "HDF5": (empty_hdf5(time=HUGE, voltage=HUGE, displacement=HUGE), MORE),
    "HDF5 batch": (empty_hdf5(time=10**6, voltage=(10**6, 1000), displacement=(10**6, 1000)), MORE),
    "HDF5 of columns": (empty_hdf5(data=(10**6, 10**6)), "columns, more than the limit of 10000"),
    "HDF5 of a chunk": (
        empty_hdf5(chunks=(2**29 - 1,), maxshape=(None,), time=(N,), voltage=(N,), displacement=(N,)),
        MORE,
    ),
    "MAT 5 compressed": (lambda path: mat_5(zeros_bomb((1, 37_500_000)))(path), MORE),
    "MAT 5 compressed, of another shape": (lambda path: mat_5(zeros_bomb((1, 1)))(path), MORE),
    "MAT 5 letters": (mat_5(array(CHAR, (1, 2**31 - 1), element(4, b""))), MORE),
    "MAT 5 struct": (mat_5(array(STRUCT, (1, 2**31 - 1), element(5, struct.pack("<i", 8)), element(1, b""))), MORE),
    "MAT 5 cell of letters": (mat_5(array(CELL, (1, 1), array(CHAR, (1, 2**31 - 1), element(4, b"")))), MORE),
    "MAT 5 negative": (
        mat_5(array(DOUBLE, (-1, 2**30), element(9, b"")), array(CHAR, (1, 2**29), element(4, b""))),
        MORE,
    ),
    "NPZ": (npz_stated, MORE),
    "NPZ array": (npz_array, "needs more memory than is free"),
    "TDMS": (tdms_texts, MORE),
    "Excel text": (long_text, MORE),
}

# The peak of the process itself: that of getrusage includes the one that started it.
READ = """
import re, sys
from pathlib import Path
from piezo_model.recordings import Recording, table
table.MOST_BYTES >>= 3
for path in sys.argv[1:]:
    try:
        Recording.open(path)
    except ValueError as error:
        print(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1], error, sep="\\t")
"""


def test_a_file_that_states_too_much_is_refused_in_little_memory(tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.mat" for name in HOSTILE]
    for path in paths:
        HOSTILE[path.stem][0](path)
    made(tmp_path, "HDF5 matrix").rename(first := tmp_path / "small.h5")
    (tmp_path / "small.h5").write_bytes(first.read_bytes()[:-8])  # a refusal that has imported the libraries
    done = python("-c", READ, first, *paths)
    assert done.stderr == ""
    (start, _), *found = (line.split("\t") for line in done.stdout.splitlines())
    for before, (peak, sentence), path in zip([start, *(peak for peak, _ in found)], found, paths, strict=False):
        assert sentence.startswith(f"{path}: "), path.stem
        assert HOSTILE[path.stem][1] in sentence, path.stem
        # Such a file would take gigabytes, or 300 MB where that has to be unpacked.
        assert int(peak) - int(before) < 100 * 1024, path.stem
    assert len(found) == len(HOSTILE)


@pytest.mark.parametrize("name", [name for name in FORMATS if "HDF5" in name or name == "NeXus"])
def test_of_a_large_file_the_arrays_that_are_wanted_are_read(tmp_path: Path, name: str) -> None:
    path = made(tmp_path, name)
    with h5py.File(path, "a") as file:
        file.create_dataset("picture", (HUGE,), "f8", chunks=True)
    recording = Recording.open(path, **FORMATS[name][1])
    np.testing.assert_array_equal((recording.x, recording.y), [X, Y])
    assert recording.sample_time == pytest.approx(PERIOD, rel=1e-12)


def test_a_batch_that_is_read_when_it_is_wanted_is_a_batch(tmp_path: Path) -> None:
    x, y = (np.tile(values[:1000], (3, 1)) for values in (X, Y))
    hdf5({"time": T[:1000], "voltage": x, "displacement": y})(tmp_path / "stage.h5")
    batch = Recording.open(tmp_path / "stage.h5")
    assert "a batch of 3 recordings of 1000 samples" in batch.describe()
    np.testing.assert_array_equal([batch.x, batch.y], [x.ravel(), y.ravel()])


def test_a_recording_that_was_read_does_not_change_with_its_file(tmp_path: Path) -> None:
    path = made(tmp_path, "MAT 5")
    recording = Recording.open(path)
    path.write_bytes(b"MATLAB 5.0 nothing")
    np.testing.assert_array_equal(recording.x, X)
    with pytest.raises(RecordingError, match="damaged"):
        Recording.open(path)
