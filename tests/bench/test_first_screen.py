"""The committed run: its report and tables follow from its measurements; its first screen on terminal and page."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from command_line import CommandLine

from bench.derived.ranking import PACE
from solvers.registry import OURS

REFERENCE = Path(__file__).parent.parent.parent / "results" / "reference"
TABLES = [path.relative_to(REFERENCE) for path in (REFERENCE / "summary.csv", *sorted(REFERENCE.glob("figures/*.csv")))]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the run, whose report is written anew."""
    folder = tmp_path_factory.mktemp("shown") / "results" / REFERENCE.name  # the report names the path of its misses
    shutil.copytree(REFERENCE, folder, ignore=shutil.ignore_patterns("report.*", "*.csv", "*.svg"))
    return folder


@pytest.fixture(scope="module")
def screen(piezobench: CommandLine, run: Path) -> list[str]:
    """The terminal after the report was written."""
    call = piezobench("report", Path("results") / run.name, folder=run.parent.parent)
    assert (call.status, call.stderr) == (0, "")
    return call.stdout.splitlines()


@pytest.mark.usefixtures("screen")
def test_the_committed_report_follows_from_the_committed_measurements_to_the_digit(run: Path) -> None:
    assert (run / "report.md").read_text(encoding="utf-8") == (REFERENCE / "report.md").read_text(encoding="utf-8")


@pytest.mark.usefixtures("screen")
@pytest.mark.parametrize("table", TABLES, ids=str)
def test_the_committed_tables_follow_from_the_committed_measurements(run: Path, table: Path) -> None:
    pd.testing.assert_frame_equal(pd.read_csv(run / table), pd.read_csv(REFERENCE / table), rtol=1e-9)


def test_the_terminal_shows_a_real_race_in_a_hundred_columns_and_forty_lines(screen: list[str]) -> None:
    assert max(map(len, screen)) <= 100
    assert len(screen) <= 40
    table = screen[next(i for i, line in enumerate(screen) if line.startswith("solver ")) + 1 :]
    assert table[0].startswith(PACE)
    assert sum(" direct " in line or " kernel " in line for line in table) >= 10


def test_our_own_solvers_are_marked_in_every_table(run: Path, screen: list[str]) -> None:
    report = (run / "report.md").read_text(encoding="utf-8")
    for line in [*screen, *report.splitlines()]:
        for solver in OURS if line.startswith(("|", *OURS)) else ():
            assert not re.search(rf"\b{solver}\b(?!†)", line), line
    assert "† ours" in report
    assert any("† ours" in line for line in screen)
