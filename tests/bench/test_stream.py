"""The stream race: the schedule on a clock of our own, then real solvers in real processes on the real one.

Nothing here asks how fast the machine is. What is asked is that the books are kept right, whatever it did.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine
from conftest import saved
from qpsolvers import Problem, Solution

import solvers
from bench.passed.progress import silent
from bench.passed.task import Task
from bench.problems.simulation import Experiment
from bench.races.calibration import Found
from bench.races.registry import kind_of, kinds
from bench.races.settings import settings_of
from bench.races.stream import figures as stream_figures
from bench.races.stream import race as stream
from bench.races.stream import report
from bench.races.stream import worker as stream_worker
from bench.races.stream.race import STREAM, StreamSettings
from bench.races.stream.staleness import Judge
from bench.races.stream.stream_problem import StreamProblem, make, regressor_rows
from bench.races.stream.worker import StreamRequest
from bench.store import Run, RunError
from bench.timing import latency_histogram, machine
from bench.timing.schedule import LEAD_NS, PERIOD_NS, SPIN_NS, Timeline, due, follow, runs
from piezo_model import DataBasis, OperatorState
from solvers import Lane, Status, Tier, Unsupported
from solvers.certificate import certify, verify
from solvers.forgetting import absorb

# The schedule, on a clock that only our own actions move.

TICK = 50
"""What one look at the clock takes, ns."""


class Clock:
    """A clock that moves by a tick when it is read and by what is slept or worked."""

    def __init__(self) -> None:
        self.now, self.slept = 0, 0

    def __call__(self) -> int:
        self.now += TICK
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)
        self.slept += 1


def run_on(clock: Clock, samples: int, service: Callable[[int], int], data: int = 0, **options: Any,
           ) -> tuple[Timeline, list[tuple[int, int]], list[tuple[int, int]]]:
    """A timeline of solves that take ``service(j)`` ns, and which samples were absorbed and handed over."""
    absorbed: list[tuple[int, int]] = []
    updated: list[tuple[int, int]] = []

    def absorb_rows(first: int, last: int) -> None:
        absorbed.append((first, last))
        clock.now += data

    def solve() -> None:
        clock.now += service(len(updated) - 1)

    timeline = follow(samples, absorb_rows, lambda first, last: updated.append((first, last)), solve, lambda j: None,
                      clock=clock, sleep=clock.sleep, **options)
    return timeline, absorbed, updated


def test_due_times_are_exact_multiples_of_the_period_whatever_the_solves_take() -> None:
    assert [due(7, k, PERIOD_NS) - 7 for k in range(4)] == [0, 125_000, 250_000, 375_000]
    timeline, *_ = run_on(Clock(), 400, lambda j: 1_000 + 317 * (j % 300))
    waited = timeline.began - timeline.solved * PERIOD_NS
    assert np.all(waited >= 0)
    assert waited[-1] <= 2 * TICK  # nothing adds up from sample to sample
    assert waited.max() <= 2 * TICK


def test_a_quick_solver_answers_every_sample_with_its_own_data() -> None:
    timeline, absorbed, updated = run_on(Clock(), 100, lambda j: 5_000)
    assert timeline.solved.tolist() == list(range(100))
    assert absorbed == updated == [(k, k) for k in range(100)]
    assert not timeline.late.any()
    assert timeline.in_use(np.ones(100, dtype=bool)).tolist() == list(range(100))


def test_what_the_data_take_is_in_no_service_time_and_before_the_due_time_where_there_is_time() -> None:
    quick, *_ = run_on(Clock(), 50, lambda j: 5_000, data=20_000)
    assert np.all(quick.data_ns >= 20_000)
    assert np.all(quick.service_ns <= 5_000 + 3 * TICK)
    assert np.all(quick.response_ns <= 5_000 + 5 * TICK)


def test_a_slow_solver_takes_the_newest_sample_with_the_data_of_those_it_missed() -> None:
    timeline, absorbed, updated = run_on(Clock(), 100, lambda j: 1_000_000)
    assert absorbed == updated
    assert [k for first, last in absorbed for k in range(first, last + 1)] == list(range(100))
    assert set(np.diff(timeline.solved)[:-1].tolist()) == {8}  # a millisecond is eight periods
    assert timeline.late.all()
    assert timeline.samples == 100


def test_one_stall_delays_all_samples_that_came_due_in_it() -> None:
    timeline, *_ = run_on(Clock(), 40, lambda j: 1_000_000 if j == 10 else 1_000)
    service, response = np.sort(timeline.service_ns), np.sort(timeline.response_ns)
    assert np.sum(service > PERIOD_NS) == 1  # all that a loop without a schedule sees
    assert np.flatnonzero(timeline.late).tolist() == list(range(10, 18))
    assert response[-8:].min() > PERIOD_NS
    assert timeline.stalls == 1


def test_figures_of_a_timeline_are_what_they_are_said_to_be() -> None:
    chance = np.random.default_rng(2)
    times = np.where(chance.random(300) < 0.1, chance.integers(0, 2_000_000, 300), chance.integers(0, 150_000, 300))
    timeline, *_ = run_on(Clock(), 300, lambda j: int(times[j]))
    usable = chance.random(timeline.solved.size) < 0.8
    in_use = timeline.in_use(usable)
    for k in range(300):
        j = next(j for j, solved in enumerate(timeline.solved) if solved >= k)
        assert timeline.response_ns[k] == timeline.ended[j] - k * PERIOD_NS
        assert timeline.response_ns[k] >= timeline.service_ns[j]
        assert timeline.late[k] == (timeline.ended[j] > (k + 1) * PERIOD_NS)
        there = [j for j, end in enumerate(timeline.ended) if usable[j] and end <= (k + 1) * PERIOD_NS]
        assert in_use[k] == (there[-1] if there else -1)


def test_a_solver_that_is_late_from_the_first_sample_on_is_stopped_and_one_that_was_in_time_once_is_not() -> None:
    hopeless, *_ = run_on(Clock(), 1000, lambda j: 1_000_000, give_up=100)
    assert 100 <= hopeless.samples < 110
    assert hopeless.response_ns.size == hopeless.samples
    saved, *_ = run_on(Clock(), 1000, lambda j: 1_000 if j == 3 else 1_000_000, give_up=100)
    assert saved.samples == 1000


def test_the_loop_sleeps_only_where_more_than_the_spin_remains() -> None:
    clock = Clock()
    run_on(clock, 20, lambda j: 1_000)
    assert clock.slept == 1  # before the first due time
    assert LEAD_NS > SPIN_NS > PERIOD_NS
    slow = Clock()
    run_on(slow, 20, lambda j: 1_000, period_ns=1_000_000)
    assert slow.slept == 20


@pytest.mark.parametrize(("late", "count"), [([], 0), ([0], 0), ([1], 1), ([1, 1, 0, 1], 2), ([0, 1, 1, 0, 0, 1, 0], 2)])
def test_stalls_are_runs_of_late_samples(late: list[int], count: int) -> None:
    assert runs(np.array(late, dtype=bool)) == count


# The stream and its optima.


@pytest.fixture(scope="module")
def short() -> StreamProblem:
    return make(Experiment("relay_preisach", "random_walk", build_s=1.0, drift_per_s=0.05), 200, 0.05, 9)


def test_the_rows_are_those_of_the_data_basis() -> None:
    experiment = Experiment("bouc_wen", "multi_sine", n=3, m=2, build_s=0.5)
    plant = experiment.sensor()
    x = experiment.reference("multi_sine", 0.5, plant)
    y = plant.run(x)
    structure = experiment.structure(plant, x, y)
    basis = DataBasis(structure, OperatorState.at_rest(structure))
    rows = regressor_rows(structure, OperatorState.at_rest(structure), x, y)
    basis.update(x, y)
    np.testing.assert_allclose(rows[:, 1:].T @ rows[:, 1:] / x.size, basis.P, rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose(rows[:, 1:].T @ rows[:, 0] / x.size, basis.q, rtol=1e-11, atol=1e-15)


def test_the_start_has_a_unit_diagonal_and_a_proven_answer(short: StreamProblem) -> None:
    assert np.array_equal(np.diag(short.start.P), np.ones(short.d))
    assert short.answer.tolist() == list(certify(short.start, short.answer).x)


def test_every_instant_is_proven_for_the_data_that_the_rows_give(short: StreamProblem) -> None:
    P, q, c = short.start.P.copy(), short.start.q.copy(), short.c
    proven = {instant.sample: instant for instant in short.instants}
    assert len(proven) == 9
    assert max(proven) == 199
    for k, row in enumerate(short.rows):
        lam, xi, x = short.forgetting, row[:-1], row[-1]
        P, q, c = lam * P + (1 - lam) * np.outer(xi, xi), lam * q + (1 - lam) * xi * x, lam * c + (1 - lam) * 0.5 * x * x
        if k in proven:
            instant = proven[k]
            np.testing.assert_allclose(instant.qp.P, P, rtol=1e-12, atol=1e-14)
            np.testing.assert_allclose(instant.qp.q, q, rtol=1e-12, atol=1e-14)
            assert instant.c == pytest.approx(c, rel=1e-12)
            assert np.array_equal(instant.qp.P, instant.qp.P.T)
            verify(instant.qp, instant.certificate)


def test_the_same_rows_give_the_same_bits_in_any_portions(short: StreamProblem) -> None:
    results = []
    for cuts in ([0, 200], [0, 1, 2, 77, 200], list(range(201))):
        P, q, c = short.start.P.copy(), short.start.q.copy(), np.array([short.c])
        for first, last in pairwise(cuts):
            absorb(P, q, c, short.rows, first, last, short.forgetting)
        results.append((P.tobytes(), q.tobytes(), c.tobytes()))
    assert len(set(results)) == 1


def test_a_stream_on_disk_is_the_same_stream(short: StreamProblem, tmp_path: Path) -> None:
    short.save(tmp_path / "stream.npz")
    loaded = StreamProblem.load(tmp_path / "stream.npz")
    assert np.array_equal(loaded.rows, short.rows)
    assert (loaded.forgetting, loaded.c, loaded.name) == (short.forgetting, short.c, short.name)
    for ours, theirs in zip(short.instants, loaded.instants, strict=True):
        assert (ours.sample, ours.c, ours.certificate) == (theirs.sample, theirs.c, theirs.certificate)
        verify(theirs.qp, theirs.certificate)


def test_gaps_in_doubles_agree_with_the_exact_ones(short: StreamProblem) -> None:
    judge = Judge.of(short)
    chance = np.random.default_rng(1)
    answers = judge.best + chance.normal(scale=1e-3, size=judge.best.shape)
    used = np.maximum(np.arange(200) - chance.integers(0, 40, 200), -1)
    gaps = judge.gaps(answers, used)
    instants, exact = judge.exact_gaps(answers, used)
    assert instants.tolist() == [instant.sample for instant in short.instants]
    np.testing.assert_allclose(gaps[instants], exact, rtol=1e-6)
    assert judge.gaps(judge.best, np.arange(200)).max() == 0.0
    assert judge.exact_gaps(judge.best, np.arange(200))[1].max() < 1e-14


@pytest.mark.parametrize(("name", "settings", "worst"), [("box_active_set", {}, 1e-14), ("recursive_active_set", {}, 1e-9),
                                                         ("projected_difference", {"steps": 2000}, 1e-1)])
def test_compiled_loops_over_rows_follow_the_optimum(short: StreamProblem, name: str, settings: dict[str, Any],
                                                     worst: float) -> None:
    solver = solvers.get(name, "kernel", **settings)
    if solver.takes_rows:
        solver = solvers.get(name, "kernel", forgetting=short.forgetting)
    solver.setup(short.start)
    solver.solve(short.answer)
    whole, nanoseconds = solver.time_rows(short.rows[:120], short.forgetting)
    rest, _ = solver.time_rows(short.rows[120:], short.forgetting)
    answers = np.vstack([whole, rest])
    assert nanoseconds.shape == (120,)
    assert nanoseconds.min() > 0
    assert 0.0 <= Judge.of(short).gaps(answers, np.arange(200)).max() < worst


def test_the_compiled_projected_step_is_the_step_of_the_paper(short: StreamProblem) -> None:
    solver = solvers.get("projected_difference", "kernel", steps=1)
    solver.setup(short.start)
    w = solver.solve(short.answer).copy()
    answers, _ = solver.time_rows(short.rows, short.forgetting)
    P, q, c = short.start.P.copy(), short.start.q.copy(), np.zeros(1)
    for k in range(200):
        absorb(P, q, c, short.rows, k, k + 1, short.forgetting)
        eta = 1.0 / np.linalg.eigvalsh(P)[-1]
        w = np.maximum(w - eta * (P @ w + q), short.start.lb)
        np.testing.assert_allclose(answers[k], w, rtol=1e-11, atol=1e-14)


def test_solvers_without_rows_say_so(short: StreamProblem) -> None:
    solver = solvers.get("accelerated_projection", "kernel")
    solver.setup(short.start)
    with pytest.raises(Unsupported, match="no compiled loop over rows"):
        solver.time_rows(short.rows, short.forgetting)
    with pytest.raises(Unsupported, match="takes no rows"):
        solver.append(short.rows[0, :-1], 1.0)


# The race.

SLOW = '''
import time
import numpy as np
from qpsolvers import Problem, Solution, solve_problem
from solvers.protocol import Lane, Solver, box_solution


class Slow(Solver):
    name = "{name}"
    lane = Lane.DIRECT
    algorithm = "dual active set"
    licence = "MIT"
    distribution = "nobody's"
    warm_startable = True
    calls = 0

    def setup(self, problem):
        self.lb, self.P, self.q = problem.lb, problem.P, problem.q

    def update(self, P=None, q=None):
        self.P, self.q = P.copy(), q.copy()

    def solve(self, warm_start=None):
        self.calls += 1
        {fault}
        self.x = solve_problem(Problem(self.P, self.q, lb=self.lb), solver="daqp").x
        return self.x

    def solution(self):
        return box_solution(Problem(self.P, self.q, lb=self.lb), self.x, True)
'''
FAULTS = {"sleeps_1_ms": "time.sleep(1e-3)", "has_no_answer": "return np.full(18, np.nan)",
          "gives_up_later": "assert self.calls < 30, 'no more'", "too_short": "return np.zeros(3)",
          "asks_for_its_last": "assert self.calls == 1 or np.array_equal(warm_start, self.x), 'another start'"}
SAMPLES, KERNEL, GIVE_UP = 400, 1000, 150


@dataclass(frozen=True)
class Streamed:
    run: Run
    rows: pd.DataFrame
    times: pd.DataFrame
    stream: StreamProblem

    def row(self, solver: str, lane: str = "direct", repeat: int = 0) -> pd.Series:
        rows = self.rows[(self.rows.solver == solver) & (self.rows.lane == lane) & (self.rows.repeat == repeat)]
        assert len(rows) == 1
        return rows.iloc[0]

    def ns(self, row: pd.Series, what: str) -> np.ndarray:
        found = self.times[(self.times.task == row.task) & (self.times.what == what)]
        assert len(found) == 1
        return np.asarray(found.ns.iloc[0])

    def timeline(self, row: pd.Series) -> Timeline:
        began, service = self.ns(row, "began"), self.ns(row, "service")
        return Timeline(int(row.samples), self.ns(row, "sample"), self.ns(row, "data"), began, began, began + service)


@pytest.fixture(scope="module")
def streamed(tmp_path_factory: pytest.TempPathFactory) -> Streamed:
    folder = tmp_path_factory.mktemp("stream")
    for name, fault in FAULTS.items():
        (folder / f"{name}.py").write_text(SLOW.format(name=name, fault=fault))
    settings = StreamSettings(
        solvers=("daqp", "box_active_set", "recursive_active_set", "accelerated_projection"),
        lanes=(Lane.KERNEL, Lane.DIRECT), samples=SAMPLES, kernel_samples=KERNEL, give_up=GIVE_UP, certified=12, repeats=2,
        solver_files=tuple(str(folder / f"{name}.py") for name in FAULTS))
    run = kinds()["stream"].start(folder, settings, "run")
    kinds()["stream"].carry_on(run, silent)
    return Streamed(run, run.rows(STREAM), run.times(), StreamProblem.load(next((run.path / "problems").glob("*.npz"))))


def test_every_solver_lane_has_a_row_a_process_and_the_floor_is_looked_at_in_each_round(streamed: Streamed) -> None:
    counts = streamed.rows.groupby(["solver", "lane"]).repeat.nunique()
    assert (counts.drop(index=[("null", "direct")]) == 2).all()
    assert len(counts) == 3 + 4 + 5 + 1  # kernel, direct, the user's, and the machine
    assert counts["null", "direct"] == 4  # twelve tasks a round, and one look before every ten


def test_the_null_solver_is_accounted_for_sample_by_sample(streamed: Streamed) -> None:
    judge = Judge.of(streamed.stream)
    for repeat in range(4):
        row = streamed.row("null", repeat=repeat)
        timeline = streamed.timeline(row)
        assert row.samples == SAMPLES
        assert row.missed == sum(response > PERIOD_NS for response in streamed.ns(row, "response").tolist())
        assert np.array_equal(timeline.response_ns, streamed.ns(row, "response"))
        assert row.unanswered == 0
        kept = judge.gaps(np.zeros((0, 18)), np.full(SAMPLES, -1))  # it keeps the answer of the start
        assert row.gap_mean == pytest.approx(kept.mean(), rel=1e-9)
        assert row.gap_max == pytest.approx(kept.max(), rel=1e-9)
        assert row.gap_max > 0.0


def test_a_solver_that_sleeps_misses_its_deadlines_and_pays_for_stale_answers(streamed: Streamed) -> None:
    row = streamed.row("sleeps_1_ms")
    assert row.missed == row.samples
    assert row.solves < row.samples
    assert row.samples >= GIVE_UP
    assert row.stopped == (f"late at each of the first {row.samples} samples" if row.samples < SAMPLES else "")
    assert row.reused == 1.0
    assert row.own_gap_max < 1e-9 < row.gap_max
    assert 0.0 < row.exact_gap_max <= row.gap_max * (1.0 + 1e-6)
    assert row.status == Status.OK  # its answers are right, and late


def test_no_solve_begins_before_its_sample_is_due(streamed: Streamed) -> None:
    for _, row in streamed.rows[streamed.rows.paced & (streamed.rows.samples > 0)].iterrows():
        assert np.all(streamed.ns(row, "began") >= streamed.ns(row, "sample") * PERIOD_NS)


def test_response_times_hold_the_service_times_and_the_waiting(streamed: Streamed) -> None:
    for _, row in streamed.rows[streamed.rows.paced & (streamed.rows.samples > 0)].iterrows():
        timeline = streamed.timeline(row)
        includes = np.searchsorted(timeline.solved, np.arange(timeline.samples))
        assert np.all(timeline.response_ns >= timeline.service_ns[includes])
    slow = streamed.timeline(streamed.row("sleeps_1_ms"))
    # What each solve took says nothing of the samples that came due meanwhile.
    assert slow.response_ns.sum() > 5 * slow.service_ns.sum()
    assert slow.response_ns.size > 5 * slow.service_ns.size


def test_solvers_that_can_start_warm_start_from_their_last_answer(streamed: Streamed) -> None:
    row = streamed.row("asks_for_its_last")
    assert (row.status, row.message) == (Status.OK, "")
    assert row.solves > 1


@pytest.mark.parametrize("solver", ["daqp", "box_active_set", "recursive_active_set"])
def test_exact_solvers_are_exact_at_the_sample_they_answer(streamed: Streamed, solver: str) -> None:
    row = streamed.row(solver)
    assert row.status == Status.OK
    assert row.own_gap_max < 1e-9
    assert row.exact_instants == 12
    assert row.exact_difference < 1e-6
    assert not row.mutates_input
    assert row.solves == streamed.ns(row, "service").size


def test_histograms_hold_the_raw_times(streamed: Streamed) -> None:
    row = streamed.row("daqp")
    assert row.response_histogram == latency_histogram.recorded(streamed.ns(row, "response"))
    assert row.service_histogram == latency_histogram.recorded(streamed.ns(row, "service"))
    loop = streamed.row("recursive_active_set", "kernel")
    assert loop.response_histogram == latency_histogram.recorded(streamed.ns(loop, "service"), PERIOD_NS)


@pytest.mark.parametrize("solver", ["box_active_set", "recursive_active_set"])
def test_the_compiled_loop_takes_more_rows_than_there_are_and_is_not_called_paced(streamed: Streamed, solver: str) -> None:
    row = streamed.row(solver, "kernel")
    assert not row.paced
    assert row.samples == streamed.ns(row, "service").size == KERNEL > SAMPLES
    assert row.exact_gap_max < 1e-9
    assert row.stopped == ""


class Recorder(solvers.Solver):
    """Keeps the rows that it is handed in compiled code's place, of each object apart."""

    name, lane, algorithm, licence, distribution = "recorder", Lane.KERNEL, "none", "MIT", "nobody's"
    seen: ClassVar[list[list[np.ndarray]]] = []

    def setup(self, problem: Problem) -> None:
        self.seen.append([])

    def update(self, P: np.ndarray | None = None, q: np.ndarray | None = None) -> None:
        raise AssertionError("nobody updates in the kernel lane")

    def solve(self, warm_start: np.ndarray | None = None) -> np.ndarray:
        raise AssertionError("it cannot start warm")

    def time_rows(self, rows: np.ndarray, forgetting: float) -> tuple[np.ndarray, np.ndarray]:
        self.seen[-1].append(rows)
        return rows[:, :-1].copy(), np.ones(len(rows), dtype=np.int64)

    def solution(self) -> Solution:
        raise AssertionError("nobody asks")


def recorded(monkeypatch: pytest.MonkeyPatch, short: StreamProblem, wall_s: float) -> stream_worker.Streamed:
    monkeypatch.setattr(stream_worker, "KERNEL_BLOCK", 70)
    monkeypatch.setattr(stream_worker, "KERNEL_WALL_S", wall_s)
    Recorder.seen.clear()
    task = Task("stream", "short", "scaled", "recorder", Lane.KERNEL, (Tier.HIGH,))
    fields = {"P": short.start.P, "q": short.start.q, "lb": short.start.lb, "ub": short.start.ub}
    outcome = StreamRequest(task, fields, short.c, short.answer, short.rows, short.forgetting, 950, 0).answer(Recorder, True)
    assert isinstance(outcome, stream_worker.Streamed), outcome.message
    return outcome


def test_the_compiled_loop_goes_along_the_rows_there_and_back(monkeypatch: pytest.MonkeyPatch, short: StreamProblem) -> None:
    outcome = recorded(monkeypatch, short, 60.0)
    there, back = short.rows, short.rows[::-1]
    assert np.array_equal(np.vstack(Recorder.seen[-1]), np.vstack([there, back, there, back, there[:150]]))
    assert outcome.kernel_ns.size == 950
    assert np.array_equal(outcome.answers, there[:, :-1])  # those of the first way, for which the optima are known


def test_the_compiled_loop_ends_at_the_block_in_which_its_time_is_spent(monkeypatch: pytest.MonkeyPatch,
                                                                        short: StreamProblem) -> None:
    assert recorded(monkeypatch, short, 0.0).kernel_ns.size == 70


def test_what_goes_wrong_is_a_row_of_its_own(streamed: Streamed) -> None:
    unsupported = streamed.row("accelerated_projection", "kernel")
    assert (unsupported.status, unsupported.samples) == (Status.UNSUPPORTED, 0)
    assert "no compiled loop over rows" in unsupported.message
    for solver, said in (("gives_up_later", "AssertionError: no more"), ("too_short", "ValueError")):
        failed = streamed.row(solver)
        assert (failed.status, failed.samples) == (Status.ADAPTER_FAILED, 0)
        assert said in failed.message


def test_a_solver_without_an_answer_leaves_the_one_before_in_use(streamed: Streamed) -> None:
    row, kept = streamed.row("has_no_answer"), streamed.row("null")
    assert row.unanswered == row.solves
    assert row.status == Status.MISSED
    if row.samples == SAMPLES:  # it may have been stopped on a machine that is busy
        assert row.gap_mean == pytest.approx(kept.gap_mean, rel=1e-9)


def test_tasks_are_shuffled_anew_in_each_round_by_the_seed(streamed: Streamed) -> None:
    settings = StreamSettings(repeats=2, seed=3)
    field = [solvers.registry.describe(entry) for entry in solvers.registry.entries()
             if entry.lane in (Lane.KERNEL, Lane.DIRECT) and entry.name in ("box_active_set", "projected_difference")]
    found = {(solver.name, solver.lane): {Tier.HIGH: Found(0, True)} for solver in field}
    orders = [[(task.solver, task.lane, task.rung) for task in stream.tasks_of(settings, field, found, streamed.stream)
               if task.repeat == repeat and task.solver != "null"] for repeat in range(2)]
    assert sorted(orders[0]) == sorted(orders[1])
    assert orders[0] != orders[1]
    again = list(stream.tasks_of(settings, field, found, streamed.stream))
    assert again == list(stream.tasks_of(settings, field, found, streamed.stream))
    assert len({task.key for task in again}) == len(again)
    assert again != list(stream.tasks_of(replace(settings, seed=4), field, found, streamed.stream))


# Figures and report.


def paced_row(solver: str, samples: int, missed: int, stalls: int, **more: Any) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(STREAM.columns, float("nan"))
    return {**row, "task": solver, "solver": solver, "lane": "direct", "tier": "high", "settings": "{}", "repeat": 0,
            "status": "ok", "message": "", "paced": True, "samples": samples, "solves": samples, "stopped": "",
            "missed": missed, "stalls": stalls, "unanswered": 0, "service_histogram": "", "response_histogram": "", **more}


def summary_of(rows: list[dict[str, Any]], **response: np.ndarray) -> pd.DataFrame:
    times = [{"task": task, "what": what, "ns": (1e3 * us).astype(np.int64)} for task, us in response.items()
             for what in ("service", "response")]
    return stream_figures.summary(pd.DataFrame(rows), pd.DataFrame(times, columns=["task", "what", "ns"]))


def test_misses_count_beyond_what_the_machine_itself_may_miss() -> None:
    rows = [paced_row("null", 30_000, 30, 30), paced_row("as_the_machine", 30_000, 40, 40), paced_row("worse", 30_000, 60, 60)]
    table = summary_of(rows).set_index("solver")
    bound = 30_000 * stream_figures.rate_bound(30, 30_000)
    assert 40 < bound < 42
    assert table.missed_beyond_floor.to_dict() == {"null": 0, "as_the_machine": 0, "worse": 60 - 41}
    assert table.status.to_dict() == {"null": "null", "as_the_machine": "ok", "worse": "late"}
    assert table.keeps_up.to_dict() == {"null": True, "as_the_machine": True, "worse": False}


def test_misses_that_come_together_bound_the_machine_less_tightly() -> None:
    alone = stream_figures.floor_bound(pd.DataFrame([paced_row("null", 30_000, 30, 30)]))
    together = stream_figures.floor_bound(pd.DataFrame([paced_row("null", 30_000, 30, 3)]))
    assert alone == stream_figures.rate_bound(30, 30_000)
    assert together == pytest.approx(10 * stream_figures.rate_bound(3, 30_000))
    assert together > alone
    assert stream_figures.floor_bound(pd.DataFrame([paced_row("null", 3_000, 0, 0)])) == stream_figures.rate_bound(0, 3_000)


@pytest.mark.parametrize(("missed", "says"), [(50, False), (51, True)])
def test_a_machine_that_misses_deadlines_itself_makes_the_verdict_say_so_first(missed: int, says: bool) -> None:
    rows = [paced_row("null", 5000, missed, missed), paced_row("daqp", 5000, 0, 0)]
    first = stream_figures.verdict(summary_of(rows, null=np.ones(5000), daqp=np.ones(5000)), {"samples": 5000, "give_up": 0})[0]
    assert first.startswith("This run cannot say who keeps the schedule") == says


def test_a_tail_that_reaches_into_the_floor_is_marked_and_an_unsupported_one_refused() -> None:
    generator = np.random.default_rng(5)
    floor = generator.exponential(1.0, 5000)
    rows = [paced_row(name, 5000, 0, 0) for name in ("null", "near", "far")]
    table = summary_of(rows, null=floor, near=floor + np.where(floor > 3.0, 0.0, 2.0), far=floor + 50.0)
    lines = table.set_index("solver")
    assert lines["at_floor_p50"].to_dict() == {"null": True, "near": False, "far": False}
    assert lines["at_floor_p99.9"].to_dict() == {"null": True, "near": True, "far": False}
    assert np.isnan(lines["response_p99.99_us"].to_numpy()).all()
    responses = report.report_of(table, {"samples": 5000, "give_up": 0}).tables[0]
    cells = {row[0]: row[4:8] for row in responses.rows}
    assert cells["near"][2].endswith("≈ floor")
    assert not cells["far"][2].endswith("≈ floor")
    assert {row[3] for row in cells.values()} == {"needs 29956"}


def test_the_report_begins_with_the_verdict_and_holds_every_lane(streamed: Streamed) -> None:
    _, path = kind_of(streamed.run).write(streamed.run)
    text = path.read_text(encoding="utf-8")
    assert "solver lanes keep the schedule of 8 kHz" in text.split("![")[0]
    assert "The machine itself, a solver that answers at once on the same schedule, misses" in text
    assert "needs 29956" in text
    assert "no compiled loop over rows" in text
    for name in (*FAULTS, "daqp", "null"):
        assert f"| {name} | direct |" in text
    for name in ("latency_tails.svg", "summary.csv"):
        assert (streamed.run.path / name).stat().st_size > 0
    summary = pd.read_csv(streamed.run.path / "summary.csv")
    assert summary.samples.sum() == streamed.rows.samples.sum()


def test_writing_the_report_again_writes_the_same(streamed: Streamed) -> None:
    kind_of(streamed.run).write(streamed.run)
    before = {name: (streamed.run.path / name).read_bytes() for name in ("report.md", "latency_tails.svg", "summary.csv")}
    kind_of(streamed.run).write(streamed.run)
    assert {name: (streamed.run.path / name).read_bytes() for name in before} == before


# The command line.


def test_a_stream_that_is_killed_is_resumed_and_keeps_what_was_done(piezobench: CommandLine, tmp_path: Path) -> None:
    words = ("--race", "stream", "--samples", 200, "--lane", "direct", "--solver", "daqp", "--solver", "quadprog", "--solver",
             "recursive_active_set", "--solver", "box_active_set")
    call, run = piezobench.start("race", *words, "--out", tmp_path, "--name", "run"), Run(tmp_path / "run")
    call.kill_once(lambda: len(list((run.path / "tasks").glob("[!.]*.npz"))) >= 2)
    assert not run.is_finished(STREAM)
    kept = saved(run, "response")
    assert len(kept) >= 2
    done = piezobench("resume", run.path)
    assert done.status == 0, done.stderr
    assert "solver lanes keep the schedule" in done.stdout
    rows, times = run.rows(STREAM), run.times()
    assert sorted(rows.solver) == ["box_active_set", "daqp", "null", "quadprog", "recursive_active_set"]
    assert rows.task.is_unique
    for task, response in kept.items():
        again = times[(times.task == task) & (times.what == "response")].ns.iloc[0]
        assert np.array_equal(again, response)
    assert "is finished already" in piezobench("resume", run.path).stdout
    assert piezobench("report", run.path).status == 0


@pytest.mark.parametrize(("words", "said"), [
    (["--samples", "100"], "only a stream has samples"), (["--race", "stream", "--set", "paper"], "a stream has its own problem"),
    (["--race", "stream", "--samples", "0"], "--samples"), (["--race", "marathon"], "'oneshot', 'anytime'"),
])
def test_options_that_do_not_go_together_are_refused(piezobench: CommandLine, tmp_path: Path, words: list[str], said: str) -> None:
    assert said in piezobench("race", *words, "--out", tmp_path / "results").refusal
    assert not (tmp_path / "results").exists()


def test_a_run_of_an_unknown_race_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"run\.json: there is no race 'marathon'; known are oneshot, anytime, batch, loop, stream"):
        kind_of(Run.create(tmp_path, {"race": "marathon", "settings": {}, "machine": machine.describe()}, "run"))


def test_settings_come_back_from_a_run_as_they_were(streamed: Streamed) -> None:
    settings = settings_of(streamed.run, StreamSettings)
    assert (settings.samples, settings.give_up, settings.tiers) == (SAMPLES, GIVE_UP, (Tier.HIGH,))
    assert isinstance(settings.experiment, Experiment)
