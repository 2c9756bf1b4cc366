"""What all tests share: no deadline for property tests, since machines differ; one browser, one command line, one
experiment."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser
from command_line import CommandLine
from figures import Figures
from hypothesis import settings
from programs import program

# The tests start hundreds of processes, each of which would compile every module of ours again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

settings.register_profile("piezobench", deadline=None)
settings.load_profile("piezobench")

SHARING = {
    "small races": (
        "border",
        "cli",
        "conditions",
        "debts",
        "engine",
        "hot_and_warm",
        "interrupts",
        "isolation",
        "report",
        "store",
    ),
    "wide race": ("compare", "deploy", "html_report"),
    "experiment": ("experiment", "figure_4_staircase"),
}
"""Files whose tests share what takes long to make: one process runs them all."""
LONGEST = ("export_c", "small races", "wide race", "stream", "experiment", "export_fmu", "fleet")
"""Groups that begin first, so that all processes end together; any other file is a group of its own."""


def group_of(nodeid: str) -> str:
    file = nodeid.partition("::")[0]
    name = Path(file).stem.removeprefix("test_")
    return next((group for group, names in SHARING.items() if name in names), name if name in LONGEST else file)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """Hand out whole groups of files where ``--dist loadfile`` hands out files."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Groups(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return group_of(nodeid)

    return Groups(config, log)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Let the longest groups begin."""
    if hasattr(config, "workerinput"):
        items.sort(
            key=lambda item: next(
                (i for i, group in enumerate(LONGEST) if group == group_of(item.nodeid)), len(LONGEST)
            )
        )


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what is marked as needing a program that is not there, before anything is made for it."""
    for mark in item.iter_markers("needs"):
        for name in mark.args:
            program(name)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = Browser()
    yield found
    found.close()


@pytest.fixture(scope="session", autouse=True)
def cache_of_its_own(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What is kept between races is kept apart from the user's, for all processes of the session."""
    folder = tmp_path_factory.getbasetemp()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(
            "XDG_CACHE_HOME", str((folder.parent if hasattr(request.config, "workerinput") else folder) / "cache")
        )
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
