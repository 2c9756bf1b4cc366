"""The first screen of the committed run: who wins at which accuracy, where the paper's method stands, in a terminal and
on the page."""

import re
import shutil
from pathlib import Path

import pytest
from command_line import CommandLine

from bench.derived.ranking import PACE
from solvers.registry import OURS

REFERENCE = Path(__file__).parent.parent.parent / "results" / "reference"


@pytest.fixture(scope="module")
def shown(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], str]:
    """What the terminal shows of a real race, and its report in Markdown."""
    run = tmp_path_factory.mktemp("shown") / REFERENCE.name
    shutil.copytree(REFERENCE, run)
    call = piezobench("report", run.name, folder=run.parent)
    assert (call.status, call.stderr) == (0, "")
    return call.stdout.splitlines(), (run / "report.md").read_text(encoding="utf-8")


def test_the_committed_report_holds_to_the_digit_what_the_committed_measurements_give(
    shown: tuple[list[str], str],
) -> None:
    _, report = shown
    assert report == (REFERENCE / "report.md").read_text(encoding="utf-8")


def test_the_terminal_shows_a_real_race_in_a_hundred_columns_and_forty_lines(shown: tuple[list[str], str]) -> None:
    lines, _ = shown
    assert max(map(len, lines)) <= 100
    assert len(lines) <= 40
    table = lines[next(i for i, line in enumerate(lines) if line.startswith("solver ")) + 1 :]
    assert table[0].startswith(PACE)
    assert sum(" direct " in line or " kernel " in line for line in table) >= 10


def test_our_own_solvers_are_marked_in_every_table(shown: tuple[list[str], str]) -> None:
    lines, report = shown
    for line in [*lines, *report.splitlines()]:
        for solver in OURS if line.startswith(("|", *OURS)) else ():
            assert not re.search(rf"\b{solver}\b(?!†)", line), line
    assert "† ours" in report
    assert any("† ours" in line for line in lines)
