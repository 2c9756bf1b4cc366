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

SHARED = {"figures": "experiment", "wide_race": "wide race", "clean_race": "small races", "faulty_race": "small races"}
"""What takes long to make, and the group of the tests that share it: one process runs them all."""
LONGEST = ("test_export_c.py", "small races", "wide race", "experiment", "test_compare.py", "test_stream.py", "test_cli.py", "test_border.py")
"""Groups that begin first, so that all processes end together; files are groups, too."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Group the tests for ``--dist loadgroup``."""
    if not hasattr(config, "workerinput"):
        return
    groups = {item: next((SHARED[name] for name in getattr(item, "fixturenames", ()) if name in SHARED), item.path.name) for item in items}
    for item, group in groups.items():
        item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=lambda item: LONGEST.index(groups[item]) if groups[item] in LONGEST else len(LONGEST))


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
        patch.setenv("XDG_CACHE_HOME", str((folder.parent if hasattr(request.config, "workerinput") else folder) / "cache"))
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
