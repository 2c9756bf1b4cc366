"""The first screen of the committed run: who wins at which accuracy, where the paper's method stands, in a terminal and
on the page."""

import re
import shutil
from pathlib import Path

import pytest
from command_line import CommandLine

from bench.derived.measurements import Measurements
from bench.derived.ranking import PACE, ranking
from bench.derived.table import ONESHOT
from bench.derived.tier_settings import FEWEST
from bench.derived.verdict import verdict
from bench.store import Run
from solvers import Tier
from solvers.registry import OURS

REFERENCE = Path(__file__).parent.parent.parent / "results" / "reference"


@pytest.fixture(scope="module")
def found() -> Measurements:
    run = Run.open(REFERENCE)
    return Measurements(run.rows(ONESHOT), run.times())


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


def test_the_papers_method_comes_first_and_what_misses_an_accuracy_ranks_below_what_reaches_it(
    found: Measurements,
) -> None:
    paper, *others = ranking(found)
    assert paper.name == PACE
    reached = [line.results[Tier.HIGH].reached for line in others]
    assert reached == sorted(reached, reverse=True)
    assert 1 < sum(reached) < len(reached)
    times = [line.results[Tier.HIGH].us for line in others if line.results[Tier.HIGH].reached]
    assert times == sorted(times)


def test_every_setting_of_a_lane_with_a_ladder_was_measured_on_every_problem_and_raw_data_at_the_default(
    found: Measurements,
) -> None:
    assert found.problems >= FEWEST
    rows = found.rows[(found.rows.start == "cold") & found.rows.lane.isin(["kernel", "direct"])]
    for _, part in rows[rows.scaling == "scaled"].groupby(["solver", "lane", "setting"]):
        assert len(part) == found.problems
    assert rows[rows.scaling == "raw"].is_default.all()
    assert rows[rows.scaling == "scaled"].groupby(["solver", "lane"]).is_default.sum().eq(found.problems).all()


def test_the_first_sentence_counts_the_solver_lanes_that_reach_a_billionth_with_one_setting(
    found: Measurements,
) -> None:
    high = found.settings[(found.settings.tier == "high") & (found.settings.scaling == "scaled")]
    says = next(said for said in verdict(found) if "solver lanes reach" in said)
    assert says.startswith(
        f"{(high.setting != '').sum()} of {len(high)} solver lanes reach 1e-9 on all "
        f"{found.problems} problems; fastest compiled "
    )
    assert " and from Python " in says
