"""Good and bad files for the tests of recordings, and the checks of every error message."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import openpyxl
import pytest

from piezo_model.recordings import Recording, RecordingError

ROWS = 1000
HEADER = "time_s,voltage_V,displacement_um"
TWO_RATES = np.concatenate([np.arange(300) * 2e-4, 0.06 + np.arange(200) * 1e-3])


N = 1300
X = np.round(50 + 50 * np.sin(6e-3 * np.arange(N)), 6)
Y = np.round(5 * np.sin(6e-3 * np.arange(N) - 0.2) + np.random.default_rng(0).normal(0, 0.01, N) - 40, 6)
"""Drive and displacement that every form of text and every format has to give back to the last bit."""


def signals(rows: int = ROWS, sample_time: float = 0.005) -> dict[str, np.ndarray]:
    t = np.arange(rows) * sample_time
    return {"time_s": t, "voltage_V": 1.8 + 1.8 * np.sin(6 * t), "displacement_um": 20 * np.sin(6 * t - 0.3) - 96}


def text_file(folder: Path, *lines: str, name: str = "stage.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def with_times(folder: Path, times: list[str] | np.ndarray, name: str = "stage.csv") -> Path:
    """A file with the given times and with varying signals."""
    return text_file(folder, HEADER, *(f"{t},{k % 7},{k % 5}" for k, t in enumerate(times)), name=name)


def waves(times: np.ndarray, header: str = HEADER) -> list[str]:
    """The lines of a table of sines at the given times."""
    return [header, *(f"{t:.7g},{np.sin(40 * t):.9g},{np.sin(40 * t - 0.3):.9g}" for t in times.tolist())]


def workbook(path: Path | BinaryIO, *rows: Iterable[object]) -> openpyxl.Workbook:
    """A workbook of one sheet with the given rows, saved."""
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(list(row))
    book.save(path)
    return book


def lines_of(*columns: np.ndarray) -> list[str]:
    """The rows of a table with every digit."""
    return [",".join(map(repr, row)) for row in zip(*(column.tolist() for column in columns), strict=True)]


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(RecordingError) as caught:
        Recording.open(path, **options)
    sentence = str(caught.value)
    assert path.name in sentence
    assert "\n" not in sentence
    return sentence


def error_of(path: Path) -> RecordingError | None:
    """The refusal of a file, if it is refused; for a child process, since a damaged file may crash a native library."""
    try:
        Recording.open(path)
    except RecordingError as error:
        return error
    return None


@contextmanager
def without_privileges() -> Iterator[None]:
    """Run as an ordinary user, for whom file permissions are effective."""
    superuser = os.geteuid() == 0
    if superuser:
        os.seteuid(65534)
    try:
        yield
    finally:
        if superuser:
            os.seteuid(0)
