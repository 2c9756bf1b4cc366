"""The problem of a stream: rows, the program they make and its proven optima, and the compiled loops that follow
them."""

from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import pytest
from qpsolvers import Problem

import solvers
from bench.messages.task import NO_SETTING, Task
from bench.problems.simulation import Experiment
from bench.races.stream import worker as stream_worker
from bench.races.stream.stream_problem import StreamProblem, make, regressor_rows
from bench.races.stream.worker import StreamRequest
from solvers import Lane, Unsupported
from solvers.certificate import certify, verify
from solvers.forgetting import absorb


@pytest.fixture(scope="module")
def short() -> StreamProblem:
    return make(Experiment("relay_preisach", "random_walk", build_s=1.0, drift_per_s=0.05), 200, 0.05, 9)


def test_the_rows_are_those_of_the_data_basis() -> None:
    _, x, y, basis = Experiment("bouc_wen", "multi_sine", n=3, m=2, build_s=0.5).measured(0.5)
    rows = regressor_rows(basis.structure, basis.state.copy(), x, y)
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
        P, q, c = (
            lam * P + (1 - lam) * np.outer(xi, xi),
            lam * q + (1 - lam) * xi * x,
            lam * c + (1 - lam) * 0.5 * x * x,
        )
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


def test_a_stream_that_is_made_again_is_the_same_stream(short: StreamProblem) -> None:
    again = make(Experiment("relay_preisach", "random_walk", build_s=1.0, drift_per_s=0.05), 200, 0.05, 9)
    assert np.array_equal(again.rows, short.rows)
    assert (again.forgetting, again.c, again.name) == (short.forgetting, short.c, short.name)
    for ours, theirs in zip(short.instants, again.instants, strict=True):
        assert (ours.sample, ours.c, ours.certificate) == (theirs.sample, theirs.c, theirs.certificate)


def test_gaps_in_doubles_agree_with_the_exact_ones(short: StreamProblem) -> None:
    chance = np.random.default_rng(1)
    answers = short.best + chance.normal(scale=1e-3, size=short.best.shape)
    used = np.maximum(np.arange(200) - chance.integers(0, 40, 200), -1)
    gaps = short.gaps(answers, used)
    instants, exact = short.exact_gaps(answers, used)
    assert instants.tolist() == [instant.sample for instant in short.instants]
    np.testing.assert_allclose(gaps[instants], exact, rtol=1e-6)
    assert short.gaps(short.best, np.arange(200)).max() == 0.0
    assert short.exact_gaps(short.best, np.arange(200))[1].max() < 1e-14


@pytest.mark.parametrize(
    ("name", "settings", "worst"),
    [
        ("box_active_set", {}, 1e-14),
        ("recursive_active_set", {}, 1e-9),
        ("projected_difference", {"steps": 2000}, 1e-1),
    ],
)
def test_compiled_loops_over_rows_follow_the_optimum(
    short: StreamProblem, name: str, settings: dict[str, Any], worst: float
) -> None:
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
    assert 0.0 <= short.gaps(answers, np.arange(200)).max() < worst


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


class Recorder(solvers.Solver):
    """Keeps the rows that it is handed in compiled code's place, of each object apart."""

    name, lane, algorithm, licence, distribution = "recorder", Lane.KERNEL, "none", "MIT", "nobody's"
    seen: ClassVar[list[list[np.ndarray]]] = []

    def setup(self, problem: Problem) -> None:
        self.seen.append([])

    def refuse(self, *_: object, **__: object) -> Any:
        raise AssertionError("in the kernel lane nothing is called but the compiled loop")

    update = solve = solution = refuse

    def time_rows(self, rows: np.ndarray, forgetting: float) -> tuple[np.ndarray, np.ndarray]:
        self.seen[-1].append(rows)
        return rows[:, :-1].copy(), np.ones(len(rows), dtype=np.int64)


def recorded(monkeypatch: pytest.MonkeyPatch, short: StreamProblem, wall_s: float) -> stream_worker.Streamed:
    monkeypatch.setattr(stream_worker, "KERNEL_BLOCK", 70)
    monkeypatch.setattr(stream_worker, "KERNEL_WALL_S", wall_s)
    Recorder.seen.clear()
    task = Task("stream", "short", "scaled", "recorder", Lane.KERNEL, NO_SETTING)
    fields = {"P": short.start.P, "q": short.start.q, "lb": short.start.lb, "ub": short.start.ub}
    outcome = StreamRequest(task, fields, short.c, short.answer, short.rows, short.forgetting, 950, 0).answer(
        Recorder, True
    )
    assert isinstance(outcome, stream_worker.Streamed), outcome.message
    return outcome


def test_the_compiled_loop_goes_along_the_rows_there_and_back(
    monkeypatch: pytest.MonkeyPatch, short: StreamProblem
) -> None:
    outcome = recorded(monkeypatch, short, 60.0)
    there, back = short.rows, short.rows[::-1]
    assert len(np.vstack(Recorder.seen[0])) == stream_worker.WARM_UP  # and not as many as are timed
    assert np.array_equal(np.vstack(Recorder.seen[-1]), np.vstack([there, back, there, back, there[:150]]))
    assert outcome.kernel_ns.size == 950
    assert np.array_equal(outcome.answers, there[:, :-1])  # those of the first way, for which the optima are known


def test_the_compiled_loop_ends_at_the_block_in_which_its_time_is_spent(
    monkeypatch: pytest.MonkeyPatch, short: StreamProblem
) -> None:
    assert recorded(monkeypatch, short, 0.0).kernel_ns.size == 70
