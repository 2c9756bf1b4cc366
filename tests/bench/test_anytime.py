"""The anytime race: points of real solvers in real processes, and what is made of them."""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import cheating_solvers
import numpy as np
import pandas as pd
import pytest
from browser import Browser
from command_line import CommandLine
from conftest import Resumed, killed_and_resumed
from programs import that_load
from qpsolvers import Problem

import solvers
from bench.passed.outcome import Outcome
from bench.passed.task import Task, settings_of, tightest
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm
from bench.races.anytime import figures as anytime_figures
from bench.races.anytime.figures import FITS, PAPER
from bench.races.anytime.race import ANYTIME, BUDGETS, LIMITS, AnytimeSettings, Curve, curve_of, point_of
from bench.races.anytime.worker import PointRequest
from bench.races.registry import kinds
from bench.report.words import marked
from bench.store import Run
from bench.timing.clock import Effort
from solvers import Lane, Status
from solvers.certificate import certify, exact_cost_gap
from solvers.descent import trajectory
from solvers.protocol import setting_text

LIMITED = [entry for entry in solvers.available()
           if entry.lane is Lane.DIRECT and entry.load().iteration_setting not in (None, "steps")]


@pytest.fixture(scope="module")
def hard() -> Problem:
    """A badly conditioned problem with some bounds active, that no iterative method solves in three steps."""
    generator = np.random.default_rng(4)
    A = generator.normal(size=(40, 12)) @ np.diag(10.0 ** -np.linspace(0.0, 2.5, 12))
    P = A.T @ A
    D = 1.0 / np.sqrt(np.diag(P))
    P = P * D * D[:, None]
    return Problem(0.5 * (P + P.T), generator.normal(size=12), lb=np.zeros(12), ub=np.full(12, np.inf))


def test_the_libraries_that_have_a_limit_name_it() -> None:
    assert {entry.name for entry in LIMITED} >= {"osqp", "scs", *that_load("proxsuite"), "piqp", "clarabel", "qpalm", "qoco"}


@pytest.mark.parametrize("entry", LIMITED, ids=lambda entry: entry.name)
def test_the_iterate_at_the_limit_can_be_had_and_is_no_answer(entry: solvers.registry.Entry, hard: Problem) -> None:
    cls = entry.load()
    solver = cls(**{**cls.ladder(1.0)[-1], str(cls.iteration_setting): 3})
    solver.setup(hard)
    assert np.isnan(solver.solve()).all()
    assert not solver.solution().found
    stood = solver.iterate()
    assert stood is not None
    assert stood.shape == (12,)
    assert np.isfinite(stood).all()


@pytest.mark.parametrize("entry", LIMITED, ids=lambda entry: entry.name)
def test_a_solve_that_came_to_its_end_stands_nowhere_else(entry: solvers.registry.Entry, hard: Problem) -> None:
    cls = entry.load()
    solver = cls(**cls.ladder(1.0)[0])
    solver.setup(hard)
    assert np.isfinite(solver.solve()).all()
    assert solver.iterate() is None


@pytest.mark.parametrize("entry", LIMITED, ids=lambda entry: entry.name)
def test_iterates_come_closer_as_the_limit_grows(entry: solvers.registry.Entry, hard: Problem) -> None:
    cls, proof, gaps = entry.load(), certify(hard, np.zeros(12)), []
    for limit in (2, 20_000):
        solver = cls(**{**cls.ladder(1.0)[-1], str(cls.iteration_setting): limit})
        solver.setup(hard)
        x = solver.solve().copy()
        if not np.isfinite(x).all():
            found = solver.iterate()
            assert found is not None
            x = found
        gap = exact_cost_gap(hard, proof, x, c=-2.0 * proof.value_rounded)
        gaps.append(gap.relative + gap.violation)
    assert gaps[1] < 1e-3 * gaps[0]


CHEATS = {"honest": "direct", "times_itself": "kernel", "lazy": "direct"}


@dataclass(frozen=True)
class Raced:
    """A race that was killed and carried on."""

    run: Run
    rows: pd.DataFrame
    resumed: Resumed

    def points(self, solver: str, lane: str = "direct", repeat: int = 0) -> pd.DataFrame:
        return self.rows[(self.rows.solver == solver) & (self.rows.lane == lane) & (self.rows.repeat == repeat)]


MINE = '''
import numpy as np
from solvers.protocol import Lane, Solver, box_solution


class Mine(Solver):
    name, lane, algorithm, licence, distribution = "raises", Lane.DIRECT, "none", "MIT", "nobody's"

    def setup(self, problem): raise RuntimeError("not today")
    def update(self, P=None, q=None): pass
    def solve(self, warm_start=None): return np.zeros(1)
    def solution(self): return None
'''


@pytest.fixture(scope="module")
def raced(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Raced:
    folder = tmp_path_factory.mktemp("anytime")
    (folder / "raises.py").write_text(MINE)
    settings = AnytimeSettings(solvers=("daqp", "osqp", "piqp", "projected_difference", "recursive_active_set"),
                               lanes=(Lane.KERNEL, Lane.DIRECT), scalings=("scaled",), limit=1, effort=Effort(0.001, 1, 20),
                               longest_s=0.02, repeats=2,
                               solver_files=(str(folder / "raises.py"), *(str(cheating_solvers.written(folder, name)) for name in CHEATS)))
    run = kinds()["anytime"].start(folder, settings, "run")
    resumed = killed_and_resumed(piezobench, run, "row", 1, "resume", run.path)
    return Raced(run, run.rows(ANYTIME), resumed)


def curve(hard: Problem, name: str, limits: tuple[int, ...], longest_s: float, rung: int | None = None) -> Curve:
    """What the child process of a race answers, which has all the time it takes."""
    entry = solvers.find(name, "direct")
    solver = solvers.registry.describe(entry)
    setting = next(each for each in settings_of(solver) if (each.is_default if rung is None else each.rung == rung))
    task = Task("set", "hard", "scaled", entry.name, entry.lane, setting)
    fields = {"P": hard.P, "q": hard.q, "lb": hard.lb, "ub": hard.ub}
    outcome = curve_of(lambda limit: PointRequest(task, fields, 1.0, Effort(0.0, 1, 1), limit, hard.P[None], 0.9 * hard.q[None], False)
                       .answer(entry.load(), True), limits, longest_s)
    assert isinstance(outcome, Curve), outcome.message
    return outcome


@pytest.mark.parametrize("name", ["osqp", "piqp"])
def test_limits_grow_and_the_curve_ends_where_the_solver_is_done(hard: Problem, name: str) -> None:
    proof, (*before, last) = certify(hard, np.zeros(12)), curve(hard, name, LIMITS, 3600.0, rung=4).points
    assert [point.limit for point in before] == list(LIMITS[:len(before)])
    assert [point.iterations for point in before] == [point.limit for point in before]
    assert not any(point.found for point in before[:-1])  # the last of them may have been done at its very limit
    assert last.found
    assert last.iterations < last.limit == LIMITS[len(before)]
    first_gap, last_gap = (exact_cost_gap(hard, proof, point.x, c=-2.0 * proof.value_rounded).relative for point in (before[0], last))
    assert last_gap < 1e-5 < first_gap


def test_no_limit_is_tried_that_would_by_the_growth_of_the_last_take_too_long(hard: Problem) -> None:
    for longest_s, points in ((0.0, 1), (3600.0, 4)):
        found = curve(hard, "projected_difference", LIMITS[:4], longest_s).points
        assert [point.limit for point in found] == list(LIMITS[:points])


def test_a_curve_is_that_of_the_solvers_tightest_setting(raced: Raced) -> None:
    for entry in solvers.available():
        points = raced.points(entry.name, entry.lane)
        tightest = setting_text({**entry.load().always, **entry.load().ladder(1.0)[-1]}) if len(points) else ""
        assert (points.setting == tightest).all()


def test_every_limit_is_timed_on_data_that_no_other_call_has_seen(hard: Problem) -> None:
    form, entry = CertifiedForm(hard, 1.0, np.eye(12), certify(hard, np.zeros(12))), solvers.find("osqp", "direct")
    task, asked = Task("set", "hard", "scaled", entry.name, entry.lane, tightest(solvers.registry.describe(entry))), []

    def ask(request: PointRequest) -> Outcome:
        asked.append(request)
        return request.answer(entry.load(), True)

    child = SimpleNamespace(ask=ask, entry=entry)
    curve_of(partial(point_of, child, task, form, FreshData(form, 1), Effort(0.001, 1, 7)), LIMITS[:3], 3600.0)
    assert len(asked) == 3
    seen = {q.tobytes() for request in asked for q in request.q}
    assert len(seen) == 21
    assert hard.q.tobytes() not in seen


def test_a_solver_without_a_limit_has_one_point(raced: Raced) -> None:
    for solver, lane in (("daqp", "direct"), ("recursive_active_set", "kernel"), ("recursive_active_set", "direct")):
        points = raced.points(solver, lane)
        assert points.limit.tolist() == [-1]
        assert points.cost_gap.iloc[0] < 1e-9
        assert points.periods.iloc[0] > 0.0


def test_points_of_the_projected_steps_are_exact_gaps_of_its_iterates(raced: Raced) -> None:
    points = raced.points("projected_difference", "kernel")
    assert len(points) >= 5
    problem = raced.run.problem(points.problem_set.iloc[0], points.problem.iloc[0])
    form = problem.forms["scaled"]
    qp = form.qp
    eta = 1.0 / np.linalg.eigvalsh(qp.P)[-1]
    for limit, gap in zip(points.limit, points.cost_gap, strict=True):
        if limit <= 1000:
            w = trajectory(qp.P, qp.q, qp.lb, qp.ub, np.zeros(qp.q.size), eta, (int(limit),))[0]
            assert gap == pytest.approx(exact_cost_gap(qp, form.certificate, w, form.c).relative, rel=1e-6)


def test_the_raw_times_of_every_point_are_kept(raced: Raced) -> None:
    times = raced.run.times()
    for _, point in raced.rows[raced.rows.samples > 0].iterrows():
        ns = times[(times.task == point.task) & (times.what == f"solve {point.limit}")].ns.iloc[0]
        assert ns.size == point.samples
        assert np.median(ns) / 1e3 == point.solve_us_p50
        assert point.periods == pytest.approx((point.update_us + point.solve_us_p50) / 125.0)


def test_every_repeat_has_its_own_rows_and_the_answers_are_the_same(raced: Raced) -> None:
    first, second = (raced.points("piqp", repeat=repeat) for repeat in range(2))
    assert first.limit.tolist() == second.limit.tolist()
    assert first.cost_gap.tolist() == second.cost_gap.tolist()
    assert not set(first.task) & set(second.task)


@pytest.mark.parametrize(("name", "lane"), CHEATS.items())
def test_a_users_file_is_timed_from_outside_until_its_answer_is_an_array(raced: Raced, name: str, lane: str) -> None:
    points = raced.points(name, lane)
    assert points.status.tolist() == [Status.OK]
    honest = raced.points("honest").solve_us_p50.iloc[0]
    assert points.solve_us_p50.iloc[0] > max(10.0, 0.2 * honest)  # each asks another solver five times


def test_a_solver_that_fails_is_one_row_with_its_reason(raced: Raced) -> None:
    failed = raced.points("raises")
    assert failed.status.tolist() == [Status.ADAPTER_FAILED]
    assert failed.message.iloc[0] == "RuntimeError: not today"
    assert np.isnan(failed.cost_gap.iloc[0])


# Figures.


def points_of(**curves: list[tuple[int, float, float]]) -> pd.DataFrame:
    """Rows of one problem from (limit, periods, gap); names that begin with steps count steps in the kernel lane."""
    rows = []
    for name, points in curves.items():
        solver, _, problem = name.partition("__")
        stepping = solver.startswith("steps")
        rows += [{"problem_set": "set", "problem": problem or "p", "d": 18, "solver": solver,
                  "lane": "kernel" if stepping else "direct", "scaling": "scaled", "limit": limit,
                  "iteration_setting": "steps" if stepping else "max_iter", "periods": periods, "cost_gap": gap, "message": ""}
                 for limit, periods, gap in points]
    return pd.DataFrame(rows)


def test_the_gap_within_a_budget_is_the_best_of_what_is_there_by_then() -> None:
    rows = points_of(a=[(1, 0.4, 1.0), (2, 1.7, 0.1), (5, 3.0, 0.3), (10, 60.0, 1e-9)])
    found = anytime_figures.within(rows).set_index("budget").gap
    for budget in BUDGETS:
        there = [gap for periods, gap in ((0.4, 1.0), (1.7, 0.1), (3.0, 0.3), (60.0, 1e-9)) if periods <= budget]
        assert found[budget] == min(there)


def test_nothing_is_there_before_the_first_point() -> None:
    wide = anytime_figures.wide(anytime_figures.summary(points_of(a=[(1, 7.0, 0.5)])))
    assert [np.isinf(wide.iloc[0][budget]) for budget in BUDGETS[:5]] == [True, True, True, False, False]


def test_a_step_a_sample_takes_a_period_whatever_it_costs() -> None:
    rows = points_of(steps=[(1, 0.01, 0.9), (100, 0.2, 0.5), (15_200, 5.0, 0.1)])
    wide = anytime_figures.wide(anytime_figures.summary(rows)).set_index("pace")
    assert (wide.loc[FITS, 1], wide.loc[FITS, 5]) == (0.5, 0.1)
    assert (wide.loc[PAPER, 1], wide.loc[PAPER, 100], wide.loc[PAPER, 10_000], wide.loc[PAPER, 15_200]) == (0.9, 0.5, 0.5, 0.1)


def test_a_problem_without_an_answer_counts_as_the_worst() -> None:
    rows = points_of(a__one=[(1, 0.5, 1e-3)], a__two=[(1, 0.5, 1e-6)], b__one=[(1, 0.5, 1e-4)], b__two=[(1, 0.5, np.nan)])
    table = anytime_figures.summary(rows).query("budget == 1").set_index("solver")
    assert table.worst_gap.to_dict() == {"a": 1e-3, "b": np.inf}
    assert table.median_gap.to_dict() == {"a": 1e-3, "b": np.inf}
    assert table.problems.to_dict() == {"a": 2, "b": 2}


def test_repeats_have_the_median_time_and_the_worst_gap() -> None:
    rows = pd.concat([points_of(a=[(1, periods, gap)]) for periods, gap in ((0.5, 1e-3), (3.0, 1e-3), (4.0, 2e-3))])
    found = anytime_figures.within(rows).set_index("budget").gap
    assert (found[2], found[5]) == (np.inf, 2e-3)


def test_the_verdict_compares_the_papers_pace_with_what_fits() -> None:
    rows = points_of(a=[(1, 0.5, 1e-12)], b=[(1, 0.5, 1e-3)])
    steps = points_of(steps=[(1, 0.01, 0.9), (15_200, 4.0, 0.1)]).assign(solver="projected_difference")
    exact, paper = anytime_figures.verdict(anytime_figures.wide(anytime_figures.summary(pd.concat([rows, steps], ignore_index=True))))
    assert "Within one sampling period 1 of 3 solver lanes reach a cost gap of 1e-09" in exact
    assert "the closest is a (direct) with 1.0e-12" in exact
    assert "is at 1.0e-01 after 15200 periods; with as many steps as fit into the time it is there within 5." in paper


def test_the_report_begins_with_the_verdict_and_holds_every_curve(raced: Raced, browser: Browser) -> None:
    _, path = kinds()["anytime"].write(raced.run)
    text = path.read_text(encoding="utf-8")
    assert "solver lanes reach a cost gap" in text.split("![")[0]
    for solver, lane, pace in (("daqp", "direct", FITS), ("osqp", "direct", FITS), ("projected_difference", "kernel", PAPER),
                               ("projected_difference", "kernel", FITS)):
        assert f"| {marked(solver)} | {lane} | {pace} |" in text
    assert "| raises | direct | scaled |" in text
    before = {name: (raced.run.path / name).read_bytes() for name in ("report.md", "anytime.svg", "summary.csv")}
    kinds()["anytime"].write(raced.run)
    assert {name: (raced.run.path / name).read_bytes() for name in before} == before
    assert browser.sections(path.with_suffix(".html")) == ["anytime"]


def test_a_race_that_was_killed_is_resumed_and_keeps_what_was_done(piezobench: CommandLine, raced: Raced) -> None:
    rows = raced.rows
    assert set(rows.solver) == {"daqp", "osqp", "piqp", "projected_difference", "recursive_active_set", "raises", *CHEATS}
    assert not rows.duplicated(["task", "limit"]).any()
    for task, row in raced.resumed.kept.items():
        before, after = json.loads(str(row)), rows[rows.task == task]
        np.testing.assert_array_equal(after.solve_us_p50, [point["solve_us_p50"] for point in before])
    assert "is finished already" in piezobench("resume", raced.run.path).stdout


def test_several_workers_are_refused_before_anything_is_made(piezobench: CommandLine, tmp_path: Path) -> None:
    said = piezobench("race", "--race", "anytime", "--workers", 2, "--out", tmp_path / "results").refusal
    assert "the anytime race runs on one core" in said
    assert not (tmp_path / "results").exists()
