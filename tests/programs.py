"""Programs and libraries that a machine with Python and make alone lacks.

A test that needs one is skipped there, and the end of the run says why, one line a reason. Where PIEZOBENCH_ALL_TESTS
is set everything has to be there, and any test that is skipped fails the run, but for those of a recording that is not
part of the project.
"""

import importlib
import os
import shutil
from pathlib import Path
from types import ModuleType
from typing import NoReturn

import pytest

from solvers import Solver
from solvers.registry import Entry, describe, find

ALL = bool(os.environ.get("PIEZOBENCH_ALL_TESTS"))
PACKAGES = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "cc": "gcc",
    "chromedriver": "chromium-driver",
    "nm": "binutils",
    "qemu-arm": "qemu-user",
}
"""Debian's, where they are not named like the program."""
RECORDINGS = (Path(os.environ.get("PIEZOBENCH_DATA", ".")), Path(__file__).parents[2] / "shared" / "data" / "dbo")
RECORDING_ABSENT = "dbo_identification.csv, a recording of a real stage, is absent: PIEZOBENCH_DATA may name its folder"


def program(name: str) -> str:
    """Path of a program; a test that asks for one which is not installed ends here."""
    return shutil.which(name) or lacking(name, PACKAGES.get(name, name))


def lacking(name: str, package: str) -> NoReturn:
    """Skip the test for want of a package of Debian."""
    pytest.skip(f"{name} is not installed: apt-get install {package} brings it on Debian")


def real_recording() -> Path:
    """Path of the recording of a real stage; a test that asks for it where it is absent ends here."""
    found = [path for folder in RECORDINGS if (path := folder / "dbo_identification.csv").is_file()]
    return found[0] if found else pytest.skip(RECORDING_ABSENT)


def library(name: str) -> ModuleType:
    """Import a library; a test, or a whole file, that asks for one which is not installed ends here."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        pytest.skip(f"{error}: make test ALL=1 installs it", allow_module_level=True)


def solver_class(entry: Entry) -> type[Solver]:
    """Import a solver; a test of one whose library is not installed ends here."""
    if absent := describe(entry).absent:
        pytest.skip(f"{absent}: make test ALL=1 installs it")
    return entry.load()


def that_load(*names: str) -> list[str]:
    """Those solvers of the lane direct whose libraries load here: some need a library of the system that comes with a
    compiler."""
    absent = {name: describe(find(name, "direct")).absent for name in names}
    assert not (ALL and any(absent.values())), absent
    return [name for name in names if not absent[name]]
