"""The report of a race whose solvers fail in every way, and of the committed run: it follows from its measurements, and
its first screen fits."""

import re
import shutil
from html import unescape
from pathlib import Path

import pandas as pd
import pytest
from command_line import CommandLine
from faulty_solvers import MARKUP
from small_races import REFERENCE, Race

from bench import rendering
from bench.derived.ranking import PACE
from bench.messages.task import Status
from bench.races.runs import write
from solvers.registry import OURS


def tables(text: str) -> list[list[list[str]]]:
    """The tables of a Markdown text as rows of cells, headings first; a backslash does not hide a bar here."""
    return [
        [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()]
        for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    ]


@pytest.fixture(scope="module")
def report(faulty_race: Race) -> str:
    return (faulty_race.run.path / "report.md").read_text(encoding="utf-8")


def test_every_table_has_as_many_cells_in_each_line_as_headings(report: str) -> None:
    assert all(len(line) == len(table[0]) for table in tables(report) for line in table)


def test_the_summary_holds_every_solver_in_each_scaling(report: str, faulty_race: Race) -> None:
    assert "[summary.csv](summary.csv)" in report
    shown = pd.read_csv(faulty_race.run.path / "summary.csv")
    key = ["solver", "lane", "tier", "scaling"]
    assert {*shown[key].itertuples(index=False, name=None)} == {
        *faulty_race.found.rows_at_tiers[key].itertuples(index=False, name=None),
        *(("floor", "direct", "default", scaling) for scaling in ("scaled", "raw")),
    }


def test_every_message_is_in_the_report_and_no_markup_of_it(report: str, faulty_race: Race) -> None:
    messages = {unescape(line[-1]) for line in tables(report)[-1][2:]}
    rows = faulty_race.rows[faulty_race.rows.solver != "null"]
    first = rows[rows.status != Status.ANSWERED].drop_duplicates(["solver", "lane", "scaling", "status"])
    assert messages == {" ".join(message.split()) for message in first.message}
    assert any("| g | (" in message for message in messages)
    assert [markup for markup in ("<script>", "`c`", "[e](f)") if markup in report] == []


def test_the_limits_say_on_how_many_hosts_was_raced(clean_race: Race, tmp_path: Path) -> None:
    limit = "{}, one run: compare ratios, not microseconds."
    assert limit.format("One machine") in (clean_race.run.path / "report.md").read_text()
    first, *others = clean_race.run.settings["conditions"]["parts"]
    two = {"parts": [first | {"host": "elsewhere"}, *others]}
    assert limit.format("2 hosts") in write(clean_race.copied(tmp_path / "two", conditions=two))[1].read_text()


def test_writing_a_report_again_writes_the_same(clean_race: Race) -> None:
    names = ("report.md", "report.html", "summary.csv", "work_precision.svg")
    before = [(clean_race.run.path / name).read_bytes() for name in names]
    write(clean_race.run)
    assert [(clean_race.run.path / name).read_bytes() for name in names] == before


@pytest.mark.parametrize("text", [MARKUP, "a\r\nb", "|", "\\|", "`|`", "<!--", "&#124;", "~~x~~ *y*"])
def test_plain_text_reads_as_it_was_and_holds_no_markup(text: str) -> None:
    plain = rendering.markdown(text)
    assert unescape(plain) == " ".join(text.split())
    assert not re.search(r"[|<>`*\[\]\\~\n]|&(?!#\d+;)", plain)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the run, whose report is written anew."""
    folder = tmp_path_factory.mktemp("shown") / "results" / REFERENCE.name  # the report names the path of its misses
    return shutil.copytree(REFERENCE, folder, ignore=shutil.ignore_patterns("report.*", "*.csv", "*.svg"))


@pytest.fixture(scope="module")
def screen(piezobench: CommandLine, run: Path) -> list[str]:
    """The terminal after the report was written."""
    return piezobench.quietly("report", Path("results") / run.name, folder=run.parent.parent).stdout.splitlines()


@pytest.mark.usefixtures("screen")
def test_the_committed_report_follows_from_the_committed_measurements_to_the_digit(run: Path) -> None:
    assert (run / "report.md").read_text(encoding="utf-8") == (REFERENCE / "report.md").read_text(encoding="utf-8")


@pytest.mark.usefixtures("screen")
@pytest.mark.parametrize(
    "table",
    [path.relative_to(REFERENCE) for path in (REFERENCE / "summary.csv", *sorted(REFERENCE.glob("figures/*.csv")))],
    ids=str,
)
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
    assert [
        line
        for line in [*screen, *report.splitlines()]
        if line.startswith(("|", *OURS)) and re.search(rf"\b({'|'.join(OURS)})\b(?!†)", line)
    ] == []
    assert ["† ours" in text for text in (report, "\n".join(screen))] == [True, True]
