"""Programs that a machine with Python and make alone lacks: what needs them is skipped there, and the summary says
why."""

import os
import shutil
from typing import NoReturn

import pytest

from solvers.registry import describe, find

PACKAGES = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "cc": "gcc",
    "chromedriver": "chromium-driver",
    "nm": "binutils",
    "qemu-arm": "qemu-user",
}
"""Debian's, where they are not named like the program."""


def program(name: str) -> str:
    """Path of a program; a test that asks for one which is not installed ends here."""
    if found := shutil.which(name):
        return found
    lacking(name, PACKAGES.get(name, name))


def that_load(*names: str) -> list[str]:
    """Those solvers of the lane direct whose libraries load here: some need a library of the system that comes with a
    compiler."""
    absent = {name: describe(find(name, "direct")).absent for name in names}
    if os.environ.get("PIEZOBENCH_ALL_PROGRAMS"):
        assert not any(absent.values()), absent
    return [name for name in names if not absent[name]]


def lacking(name: str, package: str) -> NoReturn:
    """Skip the test, or fail it where PIEZOBENCH_ALL_PROGRAMS says that everything is installed."""
    reason = f"{name} is not installed: apt-get install {package} brings it on Debian"
    if os.environ.get("PIEZOBENCH_ALL_PROGRAMS"):
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)
