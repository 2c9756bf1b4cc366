"""The first screen of a race: who wins at which accuracy, where the paper's method stands, whether the stage would notice."""

import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine

from bench.races.oneshot import plot_data
from bench.races.oneshot.ranking import PACE, PAPER, ranking, short_table
from bench.races.oneshot.rows import ONESHOT
from bench.races.oneshot.verdict import below_rounding, verdict
from bench.store import Run
from solvers import Tier
from solvers.registry import OURS

REFERENCE = Path(__file__).parent.parent.parent / "results" / "reference"


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return Run.open(REFERENCE).rows(ONESHOT)


@pytest.fixture(scope="module")
def shown(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], str]:
    """What the terminal shows of a real race, and its report in Markdown."""
    run = tmp_path_factory.mktemp("shown") / "run"
    shutil.copytree(REFERENCE, run)
    call = piezobench("report", "run", folder=run.parent)
    assert (call.status, call.stderr) == (0, "")
    return call.stdout.splitlines(), (run / "report.md").read_text(encoding="utf-8")


def test_the_terminal_shows_a_real_race_in_a_hundred_columns_and_forty_lines(shown: tuple[list[str], str]) -> None:
    lines, _ = shown
    assert max(map(len, lines)) <= 100
    assert len(lines) <= 40
    table = lines[next(i for i, line in enumerate(lines) if line.startswith("solver ")) + 1:]
    assert table[0].startswith(PACE)
    assert sum(" direct " in line or " kernel " in line for line in table) >= 10


def test_a_problem_whose_cost_a_double_does_not_resolve_to_the_tier_is_named() -> None:
    costs = pd.DataFrame({"problem": ["steep", "steep", "easy"], "d": 19, "V": [-0.2, -8.0, -0.2], "yardstick": [8e-8, 3.2e-6, 2e-5],
                          "optimum": [2.5e6, 2.5e6, 1e4]})
    (note,) = below_rounding(costs)
    assert note.startswith("On steep a cost gap of 1e-9 is 4.0e-16 of |V*|,")


def test_a_race_to_one_accuracy_names_its_fastest_without_saying_at_which(rows: pd.DataFrame) -> None:
    assert re.search(r"; fastest \w+† \(\w+\) with [\d.]+ µs", verdict(rows[rows.tier == Tier.HIGH])[0])


def test_our_own_solvers_are_marked_in_every_table(shown: tuple[list[str], str]) -> None:
    lines, report = shown
    for line in [*lines, *report.splitlines()]:
        for solver in OURS if line.startswith(("|", *OURS)) else ():
            assert not re.search(rf"\b{solver}\b(?!†)", line), line
    assert "† ours" in report
    assert any("† ours" in line for line in lines)


def test_the_papers_method_comes_first_and_what_misses_an_accuracy_ranks_below_what_reaches_it(rows: pd.DataFrame) -> None:
    paper, *others = ranking(rows)
    assert paper.name == PACE
    assert paper.results[Tier.LOW].us == 15_200 * 125.0
    reached = [line.results[Tier.HIGH].reached for line in others if Tier.HIGH in line.results]
    assert reached == sorted(reached, reverse=True)
    times = [line.results[Tier.HIGH].us for line in others if Tier.HIGH in line.results and line.results[Tier.HIGH].reached]
    assert times == sorted(times)


def test_the_papers_method_is_judged_on_the_problems_that_it_takes_and_not_mentioned_where_it_takes_none(rows: pd.DataFrame) -> None:
    def with_rows_on(problems: pd.Series) -> tuple[str, list[str]]:
        """What is said where its status there is that of a program with rows."""
        refused = rows.copy()
        there = (rows.solver == PAPER) & problems
        refused.loc[there, "status"] = "unsupported"
        refused.loc[there, ["cost_gap", "stage_excess", "update_us", "solve_us_p50"]] = np.nan
        return " ".join(verdict(refused)), [line.name for line in ranking(refused)]

    said, names = with_rows_on(rows.problem == "bouc_wen-staircase")
    assert re.search(r"reaches 1e-3 on \d, .* of 2 problems", said)
    assert names[0] == PACE
    said, names = with_rows_on(rows.problem.notna())
    assert "paper" not in said
    assert "nan" not in said
    assert PACE not in names


def test_a_cell_that_missed_is_named_so_with_its_count_and_its_time(rows: pd.DataFrame) -> None:
    spoiled = rows.copy()
    spoiled.loc[(rows.solver == "daqp") & (rows.problem == "bouc_wen-staircase") & (rows.tier == "high"), "status"] = "missed"
    (cell,) = (row[4] for row in short_table(ranking(spoiled), "").rows if row[:2] == ["daqp", "direct"])
    assert re.fullmatch(r"missed 2/3:\n[\d.]+ \([\d.]+\)", cell)


def test_the_picture_has_only_problems_on_which_every_rung_was_timed(rows: pd.DataFrame) -> None:
    table = plot_data.work_precision(rows)
    extra = rows[rows.tier == Tier.RUNG]
    count = len(extra[["problem_set", "problem"]].drop_duplicates())
    assert (table[table.scaling == "scaled"].problems == count).all()
    piqp = table[(table.solver == "piqp") & (table.lane == "direct") & (table.scaling == "scaled")]
    assert piqp[~piqp.unasked].rung.tolist() == sorted(set(rows[(rows.solver == "piqp") & (rows.lane == "direct")].rung) - {-1})
    assert piqp.unasked.sum() == 1
    assert (piqp.rung[piqp.unasked] == -1).all()


@pytest.mark.parametrize(("excess", "says"), [(0.0, "would not notice"), (0.0099, "would not notice"), (0.0101, "would notice on 1 of 3")])
def test_the_stage_notices_by_the_rule_of_its_tier_and_by_figures_that_differ(rows: pd.DataFrame, excess: float, says: str) -> None:
    rows = rows.copy()
    one = rows.problem == "bouc_wen-staircase"
    rows["stage_excess"] = np.where(one, excess, -1.0)
    rows["model_error_um"] = rows.optimum_error_um + np.where(one, 0.008 * excess, -0.008)
    *_, sentence = verdict(rows)
    assert says in sentence
    errors = re.findall(r"by ([\d.]+) µm", sentence)
    assert len(errors) == 2
    assert (errors[0] != errors[1]) == (excess > 0.0)
