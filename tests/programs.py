"""Optional programs and libraries of the tests.

A test that needs an absent one is skipped, and the run ends with one line for each reason. With PIEZOBENCH_ALL_TESTS a
skipped test fails the run, unless it needs a recording that is not part of the project.
"""

import importlib
import os
import shutil
from pathlib import Path
from types import ModuleType
from typing import NoReturn

import pytest

from solvers import Entry, Solver, describe, find

ALL = bool(os.environ.get("PIEZOBENCH_ALL_TESTS"))
COMMERCIAL = ("copt", "gurobi", "xpress")
"""Libraries that end a process in which others of them have solved before: an illegal instruction."""
PACKAGES = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "cc": "gcc",
    "chromedriver": "chromium-driver",
    "nm": "binutils",
    "qemu-arm": "qemu-user",
}
"""Debian packages that are not named like their program."""
RECORDINGS = (Path(os.environ.get("PIEZOBENCH_DATA", ".")), Path(__file__).parents[2] / "shared" / "data" / "dbo")
RECORDING_ABSENT = "dbo_identification.csv, a recording of a real stage, is absent: PIEZOBENCH_DATA may name its folder"


def program(name: str) -> str:
    """Path of a program; skips the test if it is absent."""
    return shutil.which(name) or lacking(name, PACKAGES.get(name, name))


def lacking(name: str, package: str) -> NoReturn:
    """Skip the test, which needs a package of Debian."""
    pytest.skip(f"{name} is not installed; on Debian, apt-get install {package}")


def real_recording() -> Path:
    """Path of the recording of a real stage; skips the test if it is absent."""
    found = [path for folder in RECORDINGS if (path := folder / "dbo_identification.csv").is_file()]
    return found[0] if found else pytest.skip(RECORDING_ABSENT)


def library(name: str) -> ModuleType:
    """Import a library; skips the test, or the whole file, if it is absent."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        pytest.skip(str(error), allow_module_level=True)


def solver_class(entry: Entry) -> type[Solver]:
    """Import a solver; skips the test if its library is absent."""
    if absent := describe(entry).absent:
        pytest.skip(absent)
    return entry.load()


def that_load(*names: str) -> list[str]:
    """Solvers of the lane direct whose libraries load: some need a system library that comes with a compiler."""
    absent = {name: describe(find(name, "direct")).absent for name in names}
    assert not (ALL and any(absent.values())), absent
    return [name for name in names if not absent[name]]
