"""The closed-loop race in its quick form: rows, judgement, report."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from browser import Browser
from command_line import CommandLine
from small_races import assert_harmless

from bench.messages.task import NO_SETTING, Task, Tier, silent
from bench.processes.engine import Workers
from bench.races.kind import kind_of, kinds
from bench.races.loop import race as closed_loop
from bench.races.loop import report
from bench.races.loop.race import DRIFTING, LOOP, PAPER, STILL, LoopRace, LoopSettings
from bench.races.loop.worker import drive
from bench.store import Run
from piezo_model.json_file import convert
from solvers import Lane, find
from solvers.protocol import setting_text

SETTINGS = LoopSettings(
    solvers=("box_active_set", "daqp", PAPER, "scipy_nnls"),
    lanes=(Lane.KERNEL, Lane.DIRECT),
    tiers=(Tier.HIGH,),
    quick=True,
    windows=3,
    learn_steps=(1, 1000),
)
OWN = """
from solvers.direct.daqp import Daqp as Theirs


class Mine(Theirs):
    name = "mine"
"""
STEPS_1, STEPS_1000 = '{"steps": 1}', '{"steps": 1000}'


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("loop")
    (folder / "mine.py").write_text(OWN)
    started = kinds()["loop"].start(folder, replace(SETTINGS, solver_files=(str(folder / "mine.py"),)), "loop")
    kinds()["loop"].carry_on(started, silent, Workers())
    return started


@pytest.fixture(scope="module")
def rows(run: Run) -> pd.DataFrame:
    return run.rows(LOOP)


def last(rows: pd.DataFrame, solver: str, settings: str = "{}", problem: str = STILL) -> pd.DataFrame:
    return rows[(rows.solver == solver) & (rows.settings == settings) & (rows.problem == problem) & (rows.window == 2)]


def test_there_is_a_row_for_every_learner_stage_axis_and_window(rows: pd.DataFrame) -> None:
    assert len(rows) == 6 * 2 * 2 * SETTINGS.windows
    assert not rows.duplicated(["problem", "solver", "settings", "axis", "window"]).any()
    assert set(rows.problem) == {STILL, DRIFTING}


def test_a_row_states_its_setting_and_the_basis_of_it(rows: pd.DataFrame) -> None:
    for solver in set(rows.solver) - {"mine"}:
        cls = find(solver).load()
        known = {setting_text({**cls.fixed_settings, **rung}) for rung in ({}, *cls.ladder(1.0))}
        mine = rows[rows.solver == solver]
        assert set(mine.setting) <= known
        assert set(mine.basis) == {"each" if solver == PAPER else "reference"}


def test_exact_solvers_reach_proven_optima_and_track_alike(rows: pd.DataFrame) -> None:
    ours, theirs = last(rows, "box_active_set"), last(rows, "daqp")
    for each in (ours, theirs):
        assert (each.cost_gap < 1e-9).all()
        assert (each.status == "ok").all()
        assert (each.rms_percent < 0.1 * each.straight_rms_percent).all()
    # The optima are the same, but the times of the hand-overs differ.
    np.testing.assert_allclose(ours.rms_percent, theirs.rms_percent, rtol=0.1)


def test_a_users_solver_races_with_its_tightest_setting(run: Run, rows: pd.DataFrame) -> None:
    mine, theirs = last(rows, "mine"), last(rows, "daqp")
    assert (mine.status == "ok").all()
    np.testing.assert_allclose(mine.rms_percent, theirs.rms_percent, rtol=0.05)
    assert set(mine.basis) == {"untested"}
    assert set(mine.setting) == {setting_text(find("daqp").load().ladder(1.0)[-1])}
    text = kind_of(run).write(run)[1].read_text(encoding="utf-8")
    assert "| mine, high, untested | direct |" in text
    assert "| daqp, high | direct |" in text


def test_too_few_steps_leave_a_gap_and_a_larger_tracking_error(rows: pd.DataFrame) -> None:
    few, exact = last(rows, PAPER, STEPS_1000), last(rows, "box_active_set")
    assert (few.cost_gap > 1e-3).all()
    assert np.sqrt(np.mean(few.rms_percent**2)) > 1.2 * np.sqrt(np.mean(exact.rms_percent**2))
    assert np.mean(last(rows, PAPER, STEPS_1).rms_percent) > 5.0 * np.mean(few.rms_percent)


def test_the_papers_method_learns_for_one_sample_per_step(rows: pd.DataFrame) -> None:
    assert (last(rows, PAPER, STEPS_1000).learn_samples == 1000).all()


def test_with_a_solver_that_fails_the_stage_stays_on_its_straight_line(rows: pd.DataFrame) -> None:
    none = last(rows, "scipy_nnls")
    assert (none.status == "solver_failed").all()
    assert none.message.str.contains("scipy_nnls").all()
    assert none.cost_gap.isna().all()
    np.testing.assert_allclose(none.rms_percent, none.straight_rms_percent, rtol=0.02)


def test_errors_in_percent_and_micrometres_agree(rows: pd.DataFrame) -> None:
    np.testing.assert_allclose(rows.rms_um, 0.32 * rows.rms_percent, rtol=1e-12)
    np.testing.assert_allclose(rows.max_um, 0.32 * rows.max_percent, rtol=1e-12)
    assert (rows.max_percent >= rows.rms_percent).all()


def test_all_learners_have_the_same_reference_whatever_their_phases() -> None:
    def setup(settings: dict[str, Any]) -> Any:
        return SETTINGS.setup(Task(closed_loop.SET, STILL, "scaled", PAPER, Lane.KERNEL, NO_SETTING, more=settings))

    np.testing.assert_array_equal(setup({"steps": 1}).y_ref, setup({"steps": 15200}).y_ref)
    assert setup({"steps": 1}).stage().seed == setup({"steps": 15200}).stage().seed


def test_the_problem_of_a_decision_is_the_one_that_was_solved() -> None:
    setup = replace(SETTINGS.stage(STILL), cycles=1, solver="box_active_set")
    driven = drive(setup)
    block = setup.learner(setup.structures[0])._block
    for decisions in driven.ends:
        decision = decisions[0]
        assert decision.is_hand_over
        assert decision.problem is not None
        # A solve of one sample ends with its block.
        assert decision.event.sample == decision.event.learning_since + block
        assert closed_loop.cost_gap(decision.problem, decision.weights) < 1e-12
        assert closed_loop.cost_gap(decision.problem, 1.01 * decision.weights) > 1e-6


def test_the_report_answers_whether_accuracy_matters_and_its_page_draws_it(run: Run, browser: Browser) -> None:
    assert kind_of(run) is kinds()["loop"]
    _, path = kind_of(run).write(run)
    text = path.read_text(encoding="utf-8")
    assert re.search(
        r"On the still stage \d of \d learners are within 10 % of the least error, .* nm RMS, .*; on the "
        r"drifting stage",
        text,
    )
    assert "projected_difference†, steps 1000" in text
    assert "scipy_nnls" in text.split("What went wrong")[1]
    assert "<svg" in (run.path / "loop.svg").read_text(encoding="utf-8")
    summary = pd.read_csv(run.path / "summary.csv")
    assert len(summary) == 6 * 2
    assert browser.sections(path.with_suffix(".html")) == ["loop", "loop_time"]


def test_the_verdict_says_what_the_papers_method_reaches_on_each_stage(
    rows: pd.DataFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "PAPERS_SETTING", STEPS_1000)  # the quick race has no phase of 15 200 steps
    assert re.match(
        r"The paper's method with its 15 200 steps reaches \S+ nm on the still stage, \S+ times the least, at a cost "
        r"gap of \S+; \S+ nm on the drifting stage",
        report.verdict(report.summary(rows))[1],
    )


def test_a_solver_is_not_added_to_a_loop_race(piezobench: CommandLine, run: Run) -> None:
    refusal = piezobench("race", "--into", run.path, "--solver", "daqp").refusal
    assert "solvers are added to a one-shot race, and this race is of the kind loop" in refusal


@pytest.mark.parametrize("settings", [{"learn_steps": [0]}, {"learn_steps": []}, {"windows": 0}])
def test_a_run_without_windows_or_learning_phases_is_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(settings))):
        convert(settings, LoopSettings)


def test_each_solver_races_in_its_fastest_lane() -> None:
    chosen = {entry.name: entry.lane for entry in LoopRace.entries(LoopSettings(solvers=("daqp", "box_active_set")))}
    assert chosen == {"daqp": Lane.DIRECT, "box_active_set": Lane.KERNEL}


@pytest.mark.parametrize("labels", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_no_text_of_a_closed_loop_is_evaluated_in_its_report(
    piezobench: CommandLine, browser: Browser, run: Run, tmp_path: Path, labels: bool
) -> None:
    assert_harmless(piezobench, browser, run, LOOP, tmp_path, labels)
