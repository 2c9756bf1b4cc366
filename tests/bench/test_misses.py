"""A missed answer is kept as a file from which it can be reproduced."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine
from small_races import Race, race_of

from bench.derived.summary import misses
from bench.problem_files.miss import Miss
from bench.races.runs import write
from solvers import Lane, get

SOMETIMES = '''"""A solver that is off by a thousandth on the paper's problems, and right on measured ones."""

from solvers.direct.daqp import Daqp


class Sometimes(Daqp):
    name = "sometimes"

    def solve(self, warm_start=None):
        x = super().solve(warm_start)
        return x if x.size == 19 else 1.001 * x
'''


RIGHT = SOMETIMES.replace('"sometimes"', '"right"').replace("x if x.size == 19 else 1.001 * x", "x")


@pytest.fixture(scope="module")
def race(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Race:
    """A race in which a solver misses 1e-9 on two of four problems."""
    folder = tmp_path_factory.mktemp("misses")
    (folder / "sometimes.py").write_text(SOMETIMES)
    (folder / "right.py").write_text(RIGHT)
    words = (
        "--limit",
        2,
        "--set",
        "measured",
        "--set",
        "paper",
        "--scaling",
        "scaled",
        "--budget",
        0.01,
        "--rounds",
        0,
    )
    files = ("--solver", folder / "sometimes.py", "--solver", folder / "right.py")
    return race_of(piezobench, folder, "run", *words, "--lane", "direct", "--solver", "daqp", *files)


def test_each_lane_that_misses_some_problems_has_its_worst_miss_kept(race: Race) -> None:
    found = misses(race.found)
    assert set(found.problem_set[found.solver == "sometimes"]) == {"paper"}
    kept = {path.name for path in (race.run.path / "misses").iterdir()}
    assert {name.split("-")[0] for name in kept} == set(found.solver)
    assert len(kept) == len(found.drop_duplicates(["solver", "lane"]))


def test_the_printed_lines_reproduce_the_miss(
    race: Race, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("solvers.registry._added", [])  # to which the lines add the solver of a file
    (line,) = re.findall(r"To solve the first again: (.*)$", (race.run.path / "report.md").read_text(), re.MULTILINE)
    solver = re.search(r"misses/(\w+)-direct", line)[1]
    assert re.findall(r"(\w+)\.py", line) == [solver] * (solver != "daqp")
    exec(compile(line.replace("\\", "").replace("&#39;", "'"), "report.md", "exec"), {})
    kept, again = map(float, capsys.readouterr().out.split())
    assert kept > 1e-9
    assert again == pytest.approx(kept, rel=0.5)


def test_a_kept_miss_has_the_judged_gap_and_a_solver_that_is_right_solves_it(race: Race) -> None:
    rows = race.rows.set_index("solver")
    for path in (race.run.path / "misses").iterdir():
        miss = Miss.load(path)
        worst = rows.loc[[miss.solver], ["cost_gap", "timed_gap"]].to_numpy()
        assert np.isclose(miss.gap(miss.x), worst, rtol=1e-3, atol=1e-12).any()
        assert abs(miss.gap(miss.solve(get("daqp", lane=Lane.DIRECT)))) < 1e-9


def test_no_misses_are_kept_if_none_are_wanted(race: Race, tmp_path: Path) -> None:
    run = race.copied(tmp_path / "run", settings={"keep_misses": 0})
    shutil.rmtree(run.path / "misses")
    write(run)
    assert not (run.path / "misses").exists()
