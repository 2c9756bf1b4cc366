"""Solvers are added to a finished run, and one of them again after a change."""

import json
import shutil
from pathlib import Path

import faulty_solvers
import pytest
from command_line import CommandLine
from small_races import Race, race_of

from bench.derived.measurements import ONESHOT, Measurements
from bench.store import Run
from bench.timing import machine

WORDS = ("--limit", 2, "--set", "measured", "--scaling", "scaled", "--rounds", 4, "--lane", "direct")


@pytest.fixture(scope="module")
def race(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Race:
    return race_of(
        piezobench, tmp_path_factory.mktemp("into"), "run", *WORDS, "--solver", "daqp", "--solver", "quadprog"
    )


def added(piezobench: CommandLine, race: Race, *words: object) -> Run:
    piezobench.run("race", "--into", race.run.path, *words)
    return Run.open(race.run.path)


def test_an_added_solver_has_rows_of_its_session_and_those_of_the_others_stay(
    piezobench: CommandLine, race: Race, tmp_path: Path
) -> None:
    file = faulty_solvers.written(tmp_path, "mine", "solution(self, answer)", "pass")
    run = added(piezobench, race, "--solver", file, "--lane", "direct")
    rows = run.rows(ONESHOT)
    before = rows[rows.session == 0].reset_index(drop=True)
    assert before.drop(columns=["answer"]).equals(race.rows.drop(columns=["answer"]))
    new = rows[rows.session == 1]
    assert set(new.solver) == {"mine", "daqp", "quadprog", "null"}
    assert "interleaved" not in set(new.timed)
    assert set(new.digest) == set(before.digest)
    found = Measurements.of(run)
    assert set(found.every[found.every.session == 1].solver) == {"mine"}
    assert set(found.every[found.every.session == 0].solver) == {"daqp", "quadprog", "null"}
    report = (run.path / "report.md").read_text()
    assert "mine (direct) joined later; beside them, what was timed again took this many times" in report
    assert "mine" in (run.path / "summary.csv").read_text()

    # changed, and added once more on one problem: the last session counts
    problem = before.problem.iloc[0]
    version = run.settings["field"]["mine (direct)"]
    file.write_text(file.read_text() + "# changed\n")
    again = added(piezobench, race, "--solver", file, "--problem", problem)
    assert again.settings["field"]["mine (direct)"] != version
    found = Measurements.of(again)
    mine = found.every[found.every.solver == "mine"]
    assert set(mine.session) == {2}
    assert set(mine.problem) == {problem}


def test_what_cannot_be_added_is_refused_and_the_run_stays(piezobench: CommandLine, race: Race, tmp_path: Path) -> None:
    before = {path.name for path in race.run.path.iterdir()}
    for words, sentence in (
        ((), "needs --solver: the solvers to add"),
        (("--solver", "nobody"), "there is no solver 'nobody'"),
        (("--solver", "daqp", "--limit", 3), "is for a new race; --into adds solvers to one on the same problems"),
        (("--solver", "daqp", "--problem", "nowhere"), "there is no problem 'nowhere'"),
    ):
        assert sentence in piezobench("race", "--into", race.run.path, *words).refusal
    assert {path.name for path in race.run.path.iterdir()} == before


def test_a_run_knows_the_machine_of_each_of_its_rows_and_is_refused_without_it(
    piezobench: CommandLine, race: Race, tmp_path: Path
) -> None:
    shutil.copytree(race.run.path, tmp_path / "run")
    (path,) = (tmp_path / "run" / "machines").iterdir()
    described = json.loads(text := path.read_text())
    path.write_text(text.replace('"cores": ', '"cores": 1'))
    assert f"{path}: is not what its name, a digest, was made of" in piezobench("report", tmp_path / "run").refusal
    path.unlink()
    another = described | {"cores": 1000}
    path.with_name(f"{machine.key(another)}.json").write_text(json.dumps(another))
    assert f"machines has no {path.stem}.json" in piezobench("report", tmp_path / "run").refusal

    # an older run describes one machine in run.json, and has others where solvers were added to it
    path.write_text(text)
    path.with_name(f"{machine.key(another)}.json").unlink()
    older = Run(tmp_path / "run")
    older.note(machine={**described, "processor": "An abacus"})
    assert {each["processor"] for each in older.machines.values()} == {"An abacus", described["processor"]}
    assert older.machine_of(older.rows(ONESHOT)) == described


def test_given_settings_are_raced_beside_the_defaults_in_place_of_the_ladder(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    given = """osqp={"eps_abs": 1e-6, "eps_rel": 0.0, "max_iter": 100000}"""
    words = (*WORDS, "--solver", "osqp", "--solver", "daqp", "--settings", given)
    race = race_of(piezobench, tmp_path, "run", *words)
    rows = race.hot[race.hot.solver == "osqp"]
    assert {*zip(rows.rung, rows.is_default, strict=True)} == {(-1, True), (0, False)}
    assert all(json.loads(text) == json.loads(given[5:]) for text in rows[rows.rung == 0].settings)
    assert (rows.status == "ok").all()
    assert race.hot[race.hot.solver == "daqp"].setting.nunique() == 3


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [("osqp=1e-6", "osqp: must be SOLVER={...} with settings in JSON"), ("clarabel={}", "which does not race")],
)
def test_given_settings_that_are_none_are_refused(
    piezobench: CommandLine, tmp_path: Path, settings: str, sentence: str
) -> None:
    call = piezobench("race", *WORDS, "--solver", "osqp", "--settings", settings, "--out", tmp_path)
    assert sentence in call.refusal
    assert not [*tmp_path.iterdir()]
