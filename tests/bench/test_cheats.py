"""Every way to look better than deserved is detected; each is a solver file that is raced."""

from pathlib import Path

import cheating_solvers
import numpy as np
import pytest
from command_line import CommandLine
from conftest import Race, race_of
from qpsolvers import Problem

from bench.messages.task import Setting, Task
from bench.messages.verdict import Status, Tier
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races import null_solver
from bench.races.oneshot.blocks import timed
from bench.timing.clock import Effort
from solvers import Lane, find
from solvers.certificate import certify
from solvers.registry import Entry

STATUS = {
    "honest": Status.OK,
    "caches": Status.CACHED,
    "caches_at_some_setting": Status.CACHED,
    "caches_and_falls": Status.CACHED,
    "keeps_for_its_other_settings": Status.OK,
    "stale": Status.STALE,
    "lags": Status.STALE,
    "garbage": Status.ERRATIC,
    "mends_later": Status.ERRATIC,
    "lazy": Status.LAZY,
    "looks": Status.PEEKED,
    "looks_into_memory": Status.PEEKED,
    "patches_the_clock": Status.TAMPERED,
    "patches_and_mends": Status.TAMPERED,
    "patches_the_message": Status.TAMPERED,
    "patches_the_guard": Status.TAMPERED,
    "hooks": Status.TAMPERED,
    "sends_by_itself": Status.TAMPERED,
    "rewrites_times": Status.MISTIMED,
    "loses_times": Status.TAMPERED,
    "works_ahead": Status.MISTIMED,
    "works_aside": Status.MISTIMED,
    "times_itself": Status.OK,
}


@pytest.fixture(scope="module")
def cheats(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Race:
    folder = tmp_path_factory.mktemp("cheats")
    files = [word for path in cheating_solvers.write_all(folder) for word in ("--solver", path)]
    words = (
        "--set",
        "paper",
        "--limit",
        1,
        "--scaling",
        "scaled",
        "--rounds",
        0,
        "--budget",
        0.2,
        "--solver",
        "daqp",
        "--lane",
        "direct",
        "--lane",
        "kernel",
    )
    return race_of(piezobench, folder, "cheats", *words, *files)


def test_every_cheat_is_tried() -> None:
    assert STATUS.keys() == cheating_solvers.CHEATS.keys()


@pytest.mark.parametrize("name", STATUS)
def test_a_cheat_has_its_status(cheats: Race, name: str) -> None:
    rows = cheats.rows[cheats.rows.solver == name]
    assert STATUS[name] in set(rows.status), rows.message.tolist()


@pytest.mark.parametrize("name", STATUS)
def test_a_cheat_reaches_no_tier_and_an_honest_solver_does(cheats: Race, name: str) -> None:
    found = cheats.found
    settings = found.settings[found.settings.solver == name]
    assert set(settings.tier) >= {Tier.LOW, Tier.MID, Tier.HIGH, Tier.EXACT}
    assert (settings.setting != "").any() == (STATUS[name] == Status.OK)
    assert found.tiers[found.tiers.solver == name].right.any() == (STATUS[name] == Status.OK)


def test_a_cache_is_detected_at_a_setting_drawn_by_the_parent_and_taints_all_settings(cheats: Race) -> None:
    name = "caches_at_some_setting"
    rows = cheats.rows[cheats.rows.solver == name]
    assert sorted(rows.rung) == [-1, 0, 1, 2, 3]
    assert sorted(rows.status) == ["cached", "ok", "ok", "ok", "ok"]
    found = cheats.found
    assert set(found.rows[found.rows.solver == name].status) == {"cached"}


def test_a_ladder_that_ends_before_the_drawn_setting_is_tested_at_another(cheats: Race) -> None:
    rows = cheats.rows[cheats.rows.solver == "caches_and_falls"].sort_values("rung")
    assert sorted(rows.status[:2]) == ["cached", "ok"]
    assert rows.status[2:].tolist() == ["crashed", *["not_run"] * 6]


def test_answers_kept_from_one_setting_are_of_no_use_at_another(cheats: Race) -> None:
    rows = cheats.rows[cheats.rows.solver == "keeps_for_its_other_settings"]
    assert len(rows) == 5
    assert rows.solve_us_p50.min() > 0.2 * rows.solve_us_p50.max() > 0.0


def test_a_users_solver_that_times_itself_is_timed_by_us(cheats: Race) -> None:
    us = cheats.rows.set_index("solver").solve_us_p50
    assert us["times_itself"] > 0.2 * us["honest"] > 0.0


def test_the_judged_answers_of_an_honest_solver_are_those_that_were_timed(cheats: Race) -> None:
    gaps = cheats.rows.groupby("solver").timed_gap
    assert gaps.min()["honest"] >= 0.0
    assert max(gaps.max()[["honest", "daqp"]]) <= 1e-6
    assert np.isfinite(gaps.max()["stale"])


COMPILED = """
from time import perf_counter_ns
from solvers.kernel import box_active_set

class WorksBeside(box_active_set.{cls}):
    name = "works_beside"

    @classmethod
    def ladder(cls, c):
        return ({{"refinements": 1}}, {{"refinements": 2}})

    def __init__(self, **settings):
        super().__init__()

    def time_kernel(self, P, *more, **named):
        end = perf_counter_ns() + {beside_ns} * len(P)
        while perf_counter_ns() < end:
            pass
        return super().time_kernel(P, *more, **named)
"""


@pytest.mark.parametrize(("beside_ns", "status"), [(0, None), (200_000, Status.MISTIMED)])
def test_untimed_work_of_a_compiled_solver_is_detected_by_its_cpu_time(
    beside_ns: int, status: Status | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = find("box_active_set", "kernel").load()
    (tmp_path / "works_beside.py").write_text(COMPILED.format(cls=base.__name__, beside_ns=beside_ns))
    monkeypatch.syspath_prepend(str(tmp_path))
    entry = Entry("works_beside", Lane.KERNEL, "works_beside")
    assert entry.times_itself
    qp = Problem(np.eye(18), -np.linspace(-1.0, 1.0, 18), lb=np.zeros(18), ub=np.full(18, np.inf))
    unit = CertifiedForm(qp, 1.0, np.eye(18), certify(qp, np.zeros(18)), cost_unit=1.0)
    task = Task("none", "none", "scaled", entry.name, entry.lane, Setting('{"refinements": 2}', 1, False))
    with SolverChild(entry) as child, SolverChild(null_solver.ENTRY) as idle:
        measured = timed(
            child, idle, task, RaceProblem("none", "none", {"scaled": unit}), FreshData(unit, 300), Effort(0.0, 60, 60)
        )
    assert measured.outcome.failure == "", measured.outcome.message
    assert (measured.fault and measured.fault[0]) == status
