"""What a solver does that wants to look better than it is, and what is said of it; each is a file that is really raced."""

from __future__ import annotations

import cheating_solvers
import numpy as np
import pytest
from command_line import CommandLine
from conftest import Race

from bench.races.oneshot.rows import ONESHOT
from bench.store import Run
from solvers import Status

STATUS = {
    "honest": Status.OK, "caches": Status.CACHED, "stale": Status.STALE, "lags": Status.STALE, "garbage": Status.ERRATIC,
    "mends_later": Status.ERRATIC, "lazy": Status.LAZY, "looks": Status.PEEKED, "looks_into_memory": Status.PEEKED,
    "patches_the_clock": Status.TAMPERED, "patches_and_mends": Status.TAMPERED, "patches_the_message": Status.TAMPERED,
    "hooks": Status.TAMPERED, "sends_by_itself": Status.TAMPERED, "rewrites_times": Status.MISTIMED, "works_ahead": Status.MISTIMED,
    "works_aside": Status.MISTIMED, "times_itself": Status.OK}


@pytest.fixture(scope="module")
def cheats(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Race:
    folder = tmp_path_factory.mktemp("cheats")
    files = [word for path in cheating_solvers.write_all(folder) for word in ("--solver", path)]
    call = piezobench("race", "--set", "paper", "--limit", 1, "--scaling", "scaled", "--tier", "mid", "--rounds", 0, "--budget", 0.2,
                      "--solver", "daqp", "--lane", "direct", "--lane", "kernel", "--out", folder, "--name", "cheats", *files)
    assert call.status == 0, call.stderr
    run = Run.open(folder / "cheats")
    return Race(run, run.rows(ONESHOT).set_index("solver"), call)


def test_every_cheat_is_tried() -> None:
    assert STATUS.keys() == cheating_solvers.CHEATS.keys()


@pytest.mark.parametrize("name", STATUS)
def test_a_cheat_has_the_status_of_what_it_does(cheats: Race, name: str) -> None:
    assert cheats.rows.status[name] == STATUS[name], cheats.rows.message[name]


def test_who_times_itself_is_timed_by_us(cheats: Race) -> None:
    assert cheats.rows.solve_us_p50["times_itself"] > 0.2 * cheats.rows.solve_us_p50["honest"] > 0.0


def test_the_judged_answers_of_an_honest_solver_are_those_that_were_timed(cheats: Race) -> None:
    assert len(cheats.rows.loc["daqp"]) == 2  # called from Python, and compiled
    for name in ("honest", "daqp"):
        assert cheats.rows.timed_gap.loc[[name]].between(0.0, 1e-6).all()
    assert np.isfinite(cheats.rows.timed_gap["stale"])
