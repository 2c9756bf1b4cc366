"""Decisions: the rule, the file, and that a compensator starts from it."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import slowed_solver
from command_line import CommandLine
from conftest import Race

from bench import deploy
from bench.deploy import Rule
from bench.races.oneshot import figures
from bench.races.oneshot.rows import ONESHOT
from bench.store import Run, RunError
from piezo_model import ModelError, SelfLearningCompensator, plants
from piezo_model.deployment import Deployment
from solvers import Lane

REFERENCE = Path(__file__).parent.parent.parent / "results" / "reference"
SHORT = {"reset_s": 0.01, "build_s": 0.2, "learn_s": 0.05}


@pytest.fixture
def run(wide_race: Race, tmp_path: Path) -> Run:
    shutil.copytree(wide_race.run.path, tmp_path / "run")
    return Run.open(tmp_path / "run")


def with_times(run: Run, solver: str, us: Callable[[int], np.ndarray], lane: str = "direct") -> None:
    """Replace the times of a solver's solves, shape (N,) for N of them, and leave nothing of its updates."""
    rows, times = pd.read_parquet(run.path / "rows.parquet"), pd.read_parquet(run.path / "times.parquet")
    tasks = set(rows[(rows.solver == solver) & (rows.lane == lane)].task)
    times["ns"] = [
        ns if task not in tasks else np.round(1e3 * us(len(ns))).astype(np.int64) if what.endswith("solve") else 0 * np.asarray(ns)
        for task, what, ns in zip(times.task, times.what, times.ns, strict=True)]
    times.to_parquet(run.path / "times.parquet")


def test_the_file_starts_a_compensator_that_runs_and_learns(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    call = piezobench("deploy", wide_race.run.path, "--out", tmp_path / "compensator.json", "--deadline", 1e6, "--simulated")
    assert call.status == 0, call.stderr
    learner = SelfLearningCompensator.load(tmp_path / "compensator.json", **SHORT)
    s = learner.structure
    plant = plants.get("bouc_wen", sample_time=s.sample_time)
    y_ref = s.y_centre + 0.7 * s.y_scale * np.sin(np.arange(6000) / 300)
    x, _ = learner.run(y_ref, plant.run)
    low, high = s.x_centre - s.x_scale, s.x_centre + s.x_scale
    assert np.all((x >= low) & (x <= high))
    assert any(event.what in ("hand-over", "refused") for event in learner.log)


def test_the_reference_run_gives_a_compensator_that_runs(piezobench: CommandLine, tmp_path: Path) -> None:
    call = piezobench("deploy", REFERENCE, "--out", tmp_path / "compensator.json", "--simulated")
    assert call.status == 0, call.stderr
    assert "Chosen: " in call.stdout
    assert "Model: from the problem paper/bouc_wen-multi_sine, simulated." in call.stdout
    learner = SelfLearningCompensator.load(tmp_path / "compensator.json", **SHORT)
    s = learner.structure
    y_ref = s.y_centre + 0.7 * s.y_scale * np.sin(np.arange(6000) / 300)
    x, y = learner.run(y_ref, plants.get("bouc_wen", sample_time=s.sample_time).run)
    assert np.ptp(x) > 0.3 * s.x_scale
    assert np.sqrt(np.mean((y - y_ref)[1000:] ** 2)) < 0.1 * s.y_scale
    assert any(event.what in ("hand-over", "refused") for event in learner.log)


def test_a_rule_that_nobody_of_the_reference_run_meets_writes_nothing(piezobench: CommandLine, tmp_path: Path) -> None:
    before = sorted(REFERENCE.rglob("*"))
    for words in (("--deadline", 1), ("--accuracy", 0), ("--lane", "cvxpy")):
        assert "no solver qualifies; the nearest, " in piezobench("deploy", REFERENCE, *words, "--out", tmp_path / "c.json").refusal
    assert "a solver that does nothing misses" in piezobench("deploy", REFERENCE, "--deadline", 0.001, "--out", tmp_path / "c.json").refusal
    assert list(tmp_path.iterdir()) == []
    assert sorted(REFERENCE.rglob("*")) == before


def test_runners_up_are_other_solver_lanes_and_the_nearest_is_refused_first(run: Run) -> None:
    decision = deploy.decide(run, Rule(deadline_us=1e6))
    lanes = [(each.solver, each.lane) for each in (decision.chosen, *decision.others)]
    assert len(set(lanes)) == len(lanes) > 1
    right = [each.right == each.problems for each, _ in decision.refused]
    assert right == sorted(right, reverse=True)


def test_the_file_holds_the_decision_and_its_evidence(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    call = piezobench("deploy", wide_race.run.path, "--out", tmp_path / "c.json", "--deadline", 1e6, "--simulated", "--json")
    said, written = json.loads(call.stdout), json.loads((tmp_path / "c.json").read_text())
    assert (written["format"], written["version"]) == ("piezobench-compensator", 2)
    assert (written["solver"], written["lane"], written["tier"]) == (said["solver"], said["lane"], said["tier"])
    evidence = written["evidence"]
    assert evidence["run"] == wide_race.run.path.name
    assert evidence["machine"] == wide_race.run.settings["machine"]
    assert evidence["certificate"]["unique"]
    assert evidence["certificate"]["cost_gap"] < 1e-12
    assert evidence["figures"]["right"] == evidence["figures"]["problems"]
    assert evidence["model_from"] == said["model_from"] == f"the problem {evidence['certificate']['problem_of_run']}, simulated"
    problem = wide_race.run.problem(*evidence["certificate"]["problem_of_run"].split("/"))
    model = Deployment.load(tmp_path / "c.json").model
    assert model.weights == pytest.approx(problem.optimal_weights, rel=1e-12, abs=1e-15)


def test_the_lowest_tail_wins_among_those_that_are_right_and_in_time(run: Run) -> None:
    chance = np.random.default_rng(0)
    with_times(run, "daqp", lambda n: 1.0 + 0.1 * chance.random(n))
    with_times(run, "box_active_set", lambda n: 0.5 + 20.0 * (chance.random(n) < 0.05))
    with_times(run, "osqp", lambda n: np.full(n, 0.01))
    rows = pd.read_parquet(run.path / "rows.parquet")
    rows.loc[rows.solver == "osqp", "cost_gap"] = 1e-6
    rows.to_parquet(run.path / "rows.parquet")
    decision = deploy.decide(run, Rule(accuracy=1e-11, lanes=(Lane.DIRECT,), deadline_us=100.0))
    assert decision.chosen.solver == "daqp"
    assert "box_active_set" in {each.solver for each in decision.runners_up}
    assert any(each.solver == "osqp" and "has a cost gap or violation above 1e-11 on" in why for each, why in decision.refused)


def test_a_solver_of_a_file_of_ones_own_is_not_deployed_however_good(piezobench: CommandLine, tmp_path: Path) -> None:
    words = ("race", "--set", "paper", "--limit", 1, "--tier", "high", "--scaling", "scaled", "--rounds", 0, "--out", tmp_path, "--name", "run")
    raced = piezobench(*words, "--solver", slowed_solver.write(tmp_path, 1.0), "--solver", "daqp", "--lane", "qpsolvers")
    assert raced.status == 0, raced.stderr
    deploys = ("deploy", tmp_path / "run", "--simulated", "--deadline", 1e6, "--misses", 10**6, "--accuracy", 1)
    why = "is of a file of your own, from which a compensator cannot take its solver"
    alone = piezobench(*deploys, "--lane", "direct").refusal
    assert "no solver qualifies; the nearest, slowed (direct, high, rung" in alone
    assert why in alone
    assert not (tmp_path / "run" / "compensator.json").exists()
    other = piezobench(*deploys, "--lane", "direct", "--lane", "qpsolvers")
    assert other.status == 0, other.stderr
    assert "Chosen: daqp (qpsolvers, " in other.stdout
    assert why in other.stdout


def test_deadlines_missed_beyond_the_floor_disqualify_unless_they_are_allowed(run: Run) -> None:
    with_times(run, "null", lambda n: np.full(n, 0.1))
    with_times(run, "box_active_set", lambda n: np.full(n, 2.0))
    with_times(run, "daqp", lambda n: np.where(np.arange(n) % 2, 300.0, 1.0))
    strict = deploy.decide(run, Rule(lanes=(Lane.DIRECT,)))
    assert strict.chosen.solver == "box_active_set"
    assert any(each.solver == "daqp" and "deadlines" in why for each, why in strict.refused)
    lenient = deploy.decide(run, Rule(lanes=(Lane.DIRECT,), misses=10**6))
    assert "daqp" in {each.solver for each in (lenient.chosen, *lenient.runners_up)}


def test_what_the_floor_misses_too_is_forgiven(run: Run) -> None:
    for solver in ("null", "daqp"):
        with_times(run, solver, lambda n: np.where(np.arange(n) % 2, 300.0, 1.0))
    decision = deploy.decide(run, Rule(lanes=(Lane.DIRECT,)))
    assert "daqp" in {each.solver for each in (decision.chosen, *decision.runners_up)}


@pytest.mark.parametrize(("samples", "by", "said"), [(6000, 0, "the lowest p99.9"), (400, 1, "Decided by the p99, since p99.9 needs 2995 samples")])
def test_whoever_has_too_few_samples_for_the_percentile_that_decides_is_refused_however_quick(run: Run, samples: int, by: int, said: str) -> None:
    with_times(run, "null", lambda n: np.full(n, 0.1))
    with_times(run, "daqp", lambda n: np.full(samples, 1.0))
    with_times(run, "box_active_set", lambda n: np.full(5, 0.1))
    only = run.rows(ONESHOT)
    only[only.solver.isin(["null", "daqp", "box_active_set"])].to_parquet(run.path / "rows.parquet")
    decision = deploy.decide(run, Rule(lanes=(Lane.DIRECT,), deadline_us=1e6, accuracy=1.0))
    assert decision.by == by
    assert {each.solver for each in (decision.chosen, *decision.runners_up)} == {"daqp"}
    assert any(each.solver == "box_active_set" and f"samples, and its p99{'.9' if by == 0 else ''} needs" in why for each, why in decision.refused)
    assert any(said in sentence for sentence in decision.sentences())


def test_a_run_in_which_no_solver_qualifies_says_so_and_writes_nothing(piezobench: CommandLine, run: Run) -> None:
    before = sorted(run.path.rglob("*"))
    sentence = piezobench("deploy", run.path, "--accuracy", 1e-60).refusal
    assert "no solver qualifies; the nearest, " in sentence
    assert "has a cost gap or violation above 1e-60 on" in sentence
    assert sorted(run.path.rglob("*")) == before


def test_lanes_that_nobody_raced_in_leave_nobody(run: Run) -> None:
    with pytest.raises(RunError, match="no solver qualifies, none of its solvers is in the lanes cvxpy"):
        deploy.decide(run, Rule(lanes=(Lane.CVXPY,)))


def test_a_problem_can_be_named_and_an_unknown_one_is_refused(run: Run) -> None:
    decision = deploy.decide(run, Rule(deadline_us=1e6))
    names = ["/".join(name) for name in run.rows(ONESHOT)[["problem_set", "problem"]].drop_duplicates().to_numpy()]
    for name in names:
        assert deploy.deployment(decision, problem=name, simulated=True).evidence["certificate"]["problem_of_run"] == name
    with pytest.raises(RunError, match="has no problem 'paper/none'; there are "):
        deploy.deployment(decision, problem="paper/none")


def test_a_simulated_actuator_is_refused_unless_it_is_asked_for(piezobench: CommandLine, run: Run, tmp_path: Path) -> None:
    words = ("deploy", run.path, "--out", tmp_path / "c.json", "--deadline", 1e6)
    assert "holds no model of your actuator; give one with --model" in piezobench(*words).refusal
    assert "is a simulated actuator; give a model with --model, or --simulated" in piezobench(*words, "--problem", "orders/d008").refusal
    assert not (tmp_path / "c.json").exists()


def test_a_setting_that_missed_every_tier_is_never_deployed_and_the_tier_is_one_that_was_reached(run: Run) -> None:
    lenient = Rule(accuracy=1e9, deadline_us=1e9, misses=10**9)
    decision = deploy.decide(run, lenient)
    rows = run.rows(ONESHOT)
    rows = rows[(rows.scaling == "scaled") & (rows.start == "cold")]
    for each in (decision.chosen, *decision.runners_up):
        served = rows[(rows.solver == each.solver) & (rows.lane == each.lane) & (rows.rung == each.settings["rung"])]
        assert (served.status[served.tier == each.tier] == "ok").all()
    assert any(each.tier == "" and "missed every tier" in why for each, why in decision.refused)


def test_a_percentile_is_the_same_in_the_decision_and_in_the_report(run: Run) -> None:
    with_times(run, "daqp", lambda n: 1.0 + np.arange(n) % 97)
    only = run.rows(ONESHOT)
    only[only.problem_set == "paper"].to_parquet(run.path / "rows.parquet")
    table = figures.summary(run.rows(ONESHOT), run.times())
    decision = deploy.decide(run, Rule(deadline_us=1e6, accuracy=1.0, misses=10**6))
    shown = table[(table.scaling == "scaled") & (table.start == "cold")].set_index(["solver", "lane", "tier"]).answer_us_p99
    found = {(each.solver, each.lane, each.tier): each.tail[1].value for each in (decision.chosen, *decision.runners_up)}
    assert any(value is not None for value in found.values())
    for who, value in found.items():
        assert shown[who] == pytest.approx(np.nan if value is None else value, nan_ok=True)


@pytest.mark.parametrize(("change", "reason"), [
    (lambda data: data.pop("solver"), "'solver' is missing"), (lambda data: data.update(version=1), "version 1"),
    (lambda data: data.update(format="x"), "format"), (lambda data: data.update(x_limits=[1, 0]), "x_limits"),
    (lambda data: data.update(mode="lazy"), "'lazy'"), (lambda data: data["model"].pop("w_H"), "w_H"),
    (lambda data: data.pop("model"), "'model' is missing")])
def test_a_damaged_file_is_refused_in_one_sentence_that_names_it(run: Run, tmp_path: Path, change: Callable[[dict], object],
                                                                 reason: str) -> None:
    path = tmp_path / "c.json"
    deploy.deployment(deploy.decide(run, Rule(deadline_us=1e6)), simulated=True).save(path)
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(ModelError, match=reason) as caught:
        Deployment.load(path)
    assert str(caught.value).startswith(str(path))
