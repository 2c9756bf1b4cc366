"""The problem of a stream: its rows, programs and certified optima."""

import numpy as np
import pytest

import solvers
from bench.problems.simulation import Experiment
from bench.races.stream.stream_problem import StreamProblem, make
from piezo_model.regressors import Regressors
from solvers.certificate import certify, verify
from solvers.forgetting import absorb


@pytest.fixture(scope="module")
def short() -> StreamProblem:
    return make(Experiment("relay_preisach", "random_walk", build_s=1.0, drift_per_s=0.05), 200, 0.05, 9)


def test_the_rows_are_those_of_the_data_basis() -> None:
    _, x, y, basis = Experiment("bouc_wen", "multi_sine", n=3, m=2, build_s=0.5).measured(0.5)
    s = basis.structure
    rows = Regressors(s, basis.state).rows(s.unit_input(x), s.unit_output(y))
    basis.update(x, y)
    np.testing.assert_allclose(rows[:, 1:].T @ rows[:, 1:] / x.size, basis.P, rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose(rows[:, 1:].T @ rows[:, 0] / x.size, basis.q, rtol=1e-11, atol=1e-15)


def test_the_start_has_a_unit_diagonal_and_a_proven_answer(short: StreamProblem) -> None:
    assert np.array_equal(np.diag(short.start.P), np.ones(short.d))
    assert short.answer.tolist() == list(certify(short.start, short.answer).x)


def test_every_instant_is_proven_for_the_data_that_the_rows_give(short: StreamProblem) -> None:
    P, q, c = short.start.P.copy(), short.start.q.copy(), short.c
    assert len(short.instants) == 9
    assert max(short.instants) == 199
    for k, row in enumerate(short.rows):
        lam, xi, x = short.forgetting, row[:-1], row[-1]
        P, q, c = (
            lam * P + (1 - lam) * np.outer(xi, xi),
            lam * q + (1 - lam) * xi * x,
            lam * c + (1 - lam) * 0.5 * x * x,
        )
        if instant := short.instants.get(k):
            np.testing.assert_allclose(instant.qp.P, P, rtol=1e-12, atol=1e-14)
            np.testing.assert_allclose(instant.qp.q, q, rtol=1e-12, atol=1e-14)
            assert instant.c == pytest.approx(c, rel=1e-12)
            assert np.array_equal(instant.qp.P, instant.qp.P.T)
            verify(instant.qp, instant.certificate)


def test_the_same_settings_give_the_same_stream(short: StreamProblem) -> None:
    again = make(Experiment("relay_preisach", "random_walk", build_s=1.0, drift_per_s=0.05), 200, 0.05, 9)
    assert np.array_equal(again.rows, short.rows)
    assert (again.forgetting, again.c, again.name) == (short.forgetting, short.c, short.name)
    assert again.instants.keys() == short.instants.keys()
    for sample, form in again.instants.items():
        assert (form.c, form.certificate) == (short.instants[sample].c, short.instants[sample].certificate)


def test_gaps_in_doubles_agree_with_the_exact_ones(short: StreamProblem) -> None:
    chance = np.random.default_rng(1)
    answers = short.best + chance.normal(scale=1e-3, size=short.best.shape)
    used = np.maximum(np.arange(200) - chance.integers(0, 40, 200), -1)
    gaps = short.gaps(answers, used)
    instants, exact = short.exact_gaps(answers, used)
    assert instants.tolist() == list(short.instants)
    np.testing.assert_allclose(gaps[instants], exact, rtol=1e-6)
    outside = short.best - np.abs(short.best).max() * (short.best <= short.start.lb)
    assert (short.gaps(outside, np.arange(200)) >= 0.9).all()
    assert (short.exact_gaps(outside, np.arange(200))[1] >= 0.9).all()
    assert short.gaps(short.best, np.arange(200)).max() == 0.0
    assert short.exact_gaps(short.best, np.arange(200))[1].max() < 1e-14


def test_the_compiled_projected_step_is_the_step_of_the_paper(short: StreamProblem) -> None:
    solver = solvers.get("projected_difference", "kernel", steps=1)
    solver.setup(short.start)
    x = solver.solve(short.answer).copy()
    w, P, q, c = x, short.start.P.copy(), short.start.q.copy(), np.zeros(1)
    for k in range(200):
        absorb(P, q, c, short.rows, k, k + 1, short.forgetting)
        solver.update(P, q)
        x = solver.solve(x).copy()
        eta = solver.solution().extras["eta"]
        assert 0.999 <= eta * np.linalg.eigvalsh(P)[-1] <= 1.0 + 1e-13
        w = np.maximum(w - eta * (P @ w + q), short.start.lb)
        np.testing.assert_allclose(x, w, rtol=1e-11, atol=1e-14)
