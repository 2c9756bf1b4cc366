"""What all tests share: no deadline for property tests, since machines differ; one browser, one command line, one experiment."""

import os
import sys
from collections.abc import Iterator

import pytest
from browser import Browser
from command_line import CommandLine
from figures import Figures
from hypothesis import settings

# The tests start hundreds of processes, each of which would compile every module of ours again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

settings.register_profile("piezobench", deadline=None)
settings.load_profile("piezobench")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = Browser()
    yield found
    found.close()


@pytest.fixture(scope="session", autouse=True)
def cache_of_its_own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What is kept between races is kept apart from the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def piezobench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CommandLine]:
    command = CommandLine(tmp_path_factory.mktemp("calls"))
    yield command
    command.close()


@pytest.fixture(scope="session")
def figures(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Figures:
    """The experiment in its quick form."""
    folder = tmp_path_factory.mktemp("experiment") / "figures"
    call = piezobench("experiment", "--quick", "--seed", 1, "--solver", "box_active_set", "--out", folder)
    assert call.status == 0, call.stderr
    return Figures(folder, call)
