"""Shared by all tests: order and reasons of skipped tests, profiles of Hypothesis, a browser, a command line."""

import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Browser
from command_line import CommandLine
from hypothesis import settings
from programs import ALL, RECORDING_ABSENT, program
from threadpoolctl import threadpool_info, threadpool_limits

# Without cached bytecode, each of hundreds of processes would compile every module again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# One thread of BLAS for each process: those that wait would spin on the cores of other tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
threadpool_limits(1, user_api="blas")

# The same cases in every run, so that only a change turns a test red; `--hypothesis-profile=drawn` draws others.
settings.register_profile("drawn", deadline=None, max_examples=100 if ALL else 25)
settings.register_profile("repeated", settings.get_profile("drawn"), derandomize=True)
settings.load_profile("repeated")

SHARING = {
    "small races": (
        "border",
        "cli",
        "conditions",
        "engine",
        "hot_and_warm",
        "interrupts",
        "isolation",
        "report",
        "store",
        "verify",
    ),
    "wide race": ("compare", "deploy", "html_report", "oneshot_race"),
}
"""Files whose tests share an expensive fixture: one process runs them all."""
LONGEST = ("export_c", "small races", "wide race", "figure_4_staircase", "export_fmu", "fleet", "live_ends")
"""Groups that start first, so that all processes end together; any other file is a group of its own."""
LONG_TO_MAKE = {"drift_race", "scheduler", "watched"}
"""Fixtures that take more than ten seconds for a few tests, which count as slow."""


def group_of(nodeid: str) -> str:
    file = nodeid.partition("::")[0]
    name = Path(file).stem.removeprefix("test_")
    return next((group for group, names in SHARING.items() if name in names), name if name in LONGEST else file)


def pytest_report_header() -> str:
    """The kernels in use: last bits differ between processors, and environment variables choose others."""
    blas = (
        f"{Path(info['filepath']).parent.name.partition('.')[0]} {info['internal_api']} {info.get('architecture')}"
        for info in threadpool_info()
        if info["user_api"] == "blas"
    )
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])  # type: ignore[index]
    return f"kernels: {', '.join([*sorted(blas), ' '.join(['numpy', *found])])}"


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


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark cases beyond a sample as slow, before slow tests are deselected; start with the longest groups."""
    cases: Counter[object] = Counter()
    for item in items:
        if LONG_TO_MAKE.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("slow")
        if isinstance(item, pytest.Function) and (mark := item.get_closest_marker("sample")):
            cases[item.function] += 1
            if cases[item.function] > mark.args[0]:
                item.add_marker("slow")
    if hasattr(config, "workerinput"):
        items.sort(
            key=lambda item: next(
                (i for i, group in enumerate(LONGEST) if group == group_of(item.nodeid)), len(LONGEST)
            )
        )


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests that need an absent program, before their fixtures are made."""
    for mark in item.iter_markers("needs"):
        for name in mark.args:
            program(name)


def skip_reasons(config: pytest.Config) -> Counter[str]:
    """Number of skipped tests by reason."""
    reports = config.pluginmanager.getplugin("terminalreporter").stats.get("skipped", [])
    return Counter(report.longrepr[2].removeprefix("Skipped: ") for report in reports)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """With all programs required, a skipped test fails the run."""
    if ALL and not hasattr(session.config, "workerinput") and skip_reasons(session.config).keys() - {RECORDING_ABSENT}:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Print one line for each reason."""
    reasons = skip_reasons(config)
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(
            f"{'ERROR: ' if ALL and reason != RECORDING_ABSENT else ''}{count} skipped: {reason}"
        )
    if reasons and not ALL:
        terminalreporter.write_line("make test ALL=1 installs all libraries")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = Browser()
    yield found
    found.close()


@pytest.fixture(scope="session", autouse=True)
def own_cache(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """All processes of the session use a cache apart from the user's."""
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
