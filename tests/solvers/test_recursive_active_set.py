"""The recursive exact solver against rational arithmetic, after every row of streams that are easy, degenerate and
hostile."""

import numpy as np
import pytest
from box_programs import INF, gap, inside, random_bounds, seeds, spectrum_matrix
from hypothesis import example, given, reject, settings
from hypothesis import strategies as st
from qpsolvers import Problem

from solvers import get
from solvers.core import BREAKDOWN, bindings
from solvers.exact.program import RoundingDecides
from solvers.kernel.recursive_active_set import LARGEST

REFRESH = 256
"""RECURSIVE_REFRESH of recursive.h."""
forgettings = st.sampled_from([1.0, 0.999, 0.99, 0.9, 0.5])
quick = settings(max_examples=25, deadline=None)


def recursive(P, q, lb=None, ub=None, **given_settings):
    s = get("recursive_active_set", "kernel", **given_settings)
    s.setup(Problem(P, q, lb=lb, ub=ub))
    return s


class Stream:
    """A solver, and P and q of all that it has been given, summed in plain NumPy."""

    def __init__(self, P, q, lb=None, ub=None, forgetting=1.0, **settings_):
        self.P, self.q, self.lb, self.ub, self.forgetting = P, q, lb, ub, forgetting
        self.solver = recursive(P, q, lb, ub, forgetting=forgetting, weight=1.0, **{"proximal": 0.0, **settings_})

    def append(self, row):
        self.solver.append(row[:-1], row[-1])
        self.P = self.forgetting * self.P + np.outer(row[:-1], row[:-1])
        self.q = self.forgetting * self.q + row[:-1] * row[-1]

    def problem(self):
        return Problem(self.P, self.q, lb=self.lb, ub=self.ub)

    def gap(self):
        return gap(self.problem(), self.solver.solve())


def random_row(rng, d, previous):
    """A row (ξ, x) that is plain, zero, the one before, large or tiny."""
    kind = rng.integers(0, 8)
    if kind == 0:
        return np.append(np.zeros(d), rng.normal())
    if kind == 1 and previous is not None:
        return previous
    return rng.normal(size=d + 1) * (1e3 if kind == 2 else 1e-3 if kind == 3 else 1.0)


@quick
@given(seed=seeds, d=st.integers(1, 10), forgetting=forgettings, integers=st.booleans())
def test_after_every_row_the_answer_is_the_exact_optimum_of_all_data_also_with_ties(seed, d, forgetting, integers):
    rng = np.random.default_rng(seed)
    q, (lb, ub) = rng.normal(size=d), random_bounds(rng, d)
    if integers:
        q, lb, ub = np.round(q), np.round(lb), np.round(ub)
    row, stream = None, Stream(np.eye(d), q, lb, ub, forgetting)
    for _ in range(10):
        # What fades is renewed, so that P stays regular: without information no optimum is the only one.
        renewed = np.sqrt(1.0 - forgetting) * np.eye(d + 1)[:d] if forgetting < 1.0 else np.zeros((0, d + 1))
        row = np.round(random_row(rng, d, row)) if integers else random_row(rng, d, row)
        for each in (*renewed, row):
            stream.append(each)
        x, P, q = stream.solver.solve(), stream.P, stream.q
        assert inside(x, stream.lb, stream.ub)
        # Rows of size 1e3 among fading ones bring cond P to 2e10. Then the terms of the cost are 1e7 times the cost,
        # and their rounding dominates: two orders of summing the same rows give two P.
        cost, terms = (0.5 * v @ M @ v + g @ v for v, M, g in ((x, P, q), (np.abs(x), np.abs(P), np.abs(q))))
        absolute = gap(stream.problem(), x, 1.0) * max(abs(cost), 1.0)
        assert absolute < 1e-12 * (abs(cost) + integers) + 1e-13 * terms


@settings(max_examples=12, deadline=None)
@given(seed=seeds, d=st.sampled_from([1, 4, 9, 20, 40]), forgetting=st.sampled_from([1.0, 0.999]))
def test_rows_in_up_to_forty_and_in_badly_scaled_variables_leave_the_exact_optimum(seed, d, forgetting):
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-5, 5, d) if d < 20 else np.ones(d)
    lb, ub = random_bounds(rng, d)
    stream = Stream(np.diag(scale**2), rng.normal(size=d) * scale, lb / scale, ub / scale, forgetting)
    for k in range(30):
        stream.append(np.append(rng.normal(size=d) * scale, rng.normal()))
        assert stream.gap() < 1e-12 or (d >= 20 and k < 29)


@quick
@given(seed=seeds, d=st.integers(1, 12), forgetting=forgettings, proximal=st.sampled_from([0.0, 1e-10, 1e-6]))
@example(seed=3, d=3, forgetting=1.0, proximal=0.0)
def test_from_the_first_row_on_the_answer_is_the_optimum_with_the_documented_proximal_term(
    seed, d, forgetting, proximal
):
    rng = np.random.default_rng(seed)
    lb, ub = random_bounds(rng, d)
    row, s = None, recursive(np.zeros((d, d)), np.zeros(d), lb, ub, forgetting=forgetting, proximal=proximal)
    for _ in range(8):
        row = random_row(rng, d, row)
        s.append(row[:-1], row[-1])
        assert inside(s.solve(), lb, ub)
        try:
            distance = gap(s.problem(), s.solve())
        except RoundingDecides:
            reject()  # rounding has made a singular P indefinite, and there is no proven optimum to compare with
        # the inverse of a matrix that is singular but for 1e-11 has five digits; the largest observed value is 2.1e-10
        assert distance < 1e-9


@quick
@given(seed=seeds, d=st.integers(2, 9))
def test_directions_that_the_data_do_not_determine_keep_their_values(seed, d):
    rng = np.random.default_rng(seed)
    s = recursive(np.zeros((d, d)), np.zeros(d), proximal=0.0)
    row = rng.normal(size=d)
    s.append(row, 1.0)
    np.testing.assert_allclose(s.solve(), -1.0 / (d * row), rtol=1e-3)  # from 0 the shortest way in √P_jj v_j
    before = s.solve().copy()
    for _ in range(3):
        s.append(row, 1.0)
    np.testing.assert_allclose(s.solve(), before, rtol=1e-7, atol=1e-9)


def drifting(rng, d, count):
    """Rows of a system whose parameters drift, with correlated inputs."""
    inputs = np.cumsum(rng.normal(size=(count, d)), axis=1) / np.sqrt(d)
    parameters = 0.3 + np.sin(np.arange(count)[:, None] * 1e-4 + np.arange(d))
    return np.column_stack([inputs, -(inputs * parameters).sum(axis=1) + 0.01 * rng.normal(size=count)])


@pytest.mark.parametrize("forgetting", [1.0, 0.999])
def test_a_hundred_thousand_rows_with_drift_stay_exact(forgetting):
    rng = np.random.default_rng(5)
    d, count, block = 12, 100_000, 9_973
    rows, lb, ub = drifting(rng, d, count), np.zeros(d), np.where(np.arange(d) % 3 == 0, 0.8, INF)
    weight = 1.0 - forgetting if forgetting < 1.0 else 1.0
    P, q, c = np.eye(d), np.zeros(d), np.zeros(1)
    s = recursive(P, q, lb, ub, forgetting=forgetting, proximal=0.0)
    for first in range(0, count, block):
        part = rows[first : first + block]
        answers, nanoseconds = s.time_rows(part, forgetting)
        assert nanoseconds.shape == (len(part),)
        assert nanoseconds.min() > 0
        if forgetting < 1.0:
            bindings.absorb(P, q, c, part, forgetting)
        else:
            P, q = P + part[:, :-1].T @ part[:, :-1] * weight, q + part[:, :-1].T @ part[:, -1] * weight
        assert gap(Problem(P, q, lb=lb, ub=ub), answers[-1]) < 1e-12
        assert bindings.recursive_error(s.state) < 1e-9
        assert gap(s.problem(), answers[-1]) < 1e-20
    extras = s.solution().extras
    assert extras["refreshes"] >= count // REFRESH
    assert extras["exchanges"] > 0
    assert extras["cold_starts"] == 0


def test_a_row_in_an_undetermined_direction_causes_a_refresh_at_once():
    s = recursive(np.diag([1.0, 1e-9]), np.zeros(2), proximal=0.0)
    s.append(np.zeros(2), 0.0)  # the first row makes the matrix
    before = s.solution().extras["refreshes"]
    s.append(np.array([0.5, 0.0]), 1.0)
    assert s.solution().extras["refreshes"] == before
    s.append(np.array([0.0, 1.0]), 1.0)
    assert s.solution().extras["refreshes"] > before
    np.testing.assert_allclose(s.solve(), [-0.4, -1.0], rtol=1e-8)


@pytest.mark.parametrize("damage", [np.nan, INF, 0.0, 1e8])
def test_a_damaged_swept_matrix_is_recomputed_and_the_answer_is_exact(damage):
    rng = np.random.default_rng(8)
    d = 9
    stream = Stream(np.eye(d), rng.normal(size=d), np.zeros(d), np.full(d, INF))
    for k in range(30):
        if k == 20:  # no longer the inverse of anything definite, the answer included
            M = stream.solver.part("M").reshape(16, 16)
            np.fill_diagonal(M[:d, :d], damage)
            M[d, :d] = damage if np.isnan(damage) else 1.0
        stream.append(rng.normal(size=d + 1))
        if k == 20:
            bindings.recursive_recover(stream.solver.state)
        assert stream.gap() < 1e-12


def test_exchanges_that_do_not_end_fall_back_on_the_cold_solver(monkeypatch):
    rng = np.random.default_rng(9)
    stream = Stream(np.eye(8), rng.normal(size=8), np.zeros(8), np.full(8, INF))
    # What the step returns where both refreshes end in vain; the row is in the Gram matrix by then.
    taken = bindings.recursive_append
    monkeypatch.setattr(bindings, "recursive_append", lambda *arrays: max(taken(*arrays), BREAKDOWN))
    for k in range(5):
        stream.append(rng.normal(size=9))
        assert stream.gap() < 1e-12
        assert stream.solver.solution().extras["cold_starts"] == k + 1


@quick
@given(
    seed=seeds, d=st.integers(1, 9), words=st.lists(st.sampled_from(["append", "many", "update", "setup"]), max_size=8)
)
def test_any_mixture_of_calls_answers_as_a_fresh_solver_does(seed, d, words):
    rng = np.random.default_rng(seed)
    P, q, (lb, ub) = np.eye(d), np.zeros(d), random_bounds(rng, d)
    s = recursive(P, q, lb, ub, proximal=0.0)
    for word in words:
        rows = rng.normal(size=(5, d + 1))
        match word:
            case "append":
                s.append(rows[0, :-1], rows[0, -1])
                rows = rows[:1]
            case "many":
                s.time_rows(rows, 1.0)
            case "update" | "setup":
                P, q = spectrum_matrix(rng, d, 1.0), rng.normal(size=d)
                lb, ub = (lb, ub) if word == "update" else random_bounds(rng, d)
                s.update(P, q) if word == "update" else s.setup(Problem(P, q, lb=lb, ub=ub))
                rows = rows[:0]
        P, q = P + rows[:, :-1].T @ rows[:, :-1], q + rows[:, :-1].T @ rows[:, -1]
    np.testing.assert_allclose(s.solve(), recursive(P, q, lb, ub, proximal=0.0).solve(), rtol=1e-10, atol=1e-10)


def test_rows_one_by_one_and_in_one_call_give_the_same_bits():
    rng = np.random.default_rng(10)
    rows = rng.normal(size=(600, 8))
    one, many = (recursive(np.eye(7), np.zeros(7), np.zeros(7), forgetting=0.99) for _ in range(2))
    answers, _ = many.time_rows(rows, 0.99)
    for row, answer in zip(rows, answers, strict=True):
        one.append(row[:-1], row[-1])
        assert (one.solve() == answer).all()


@pytest.mark.parametrize("bad", [np.nan, INF, -INF, LARGEST])
@pytest.mark.parametrize("where", [0, 3, 4])
def test_a_row_that_is_not_finite_is_refused_and_changes_nothing(bad, where):
    s, untouched = (recursive(np.eye(4), -np.ones(4), np.zeros(4)) for _ in range(2))
    row = np.ones(5)
    row[where] = bad
    with pytest.raises(ValueError, match="the row holds a number that is not finite"):
        s.append(row[:-1], row[-1])
    with pytest.raises(ValueError, match="row 1 holds a number that is not finite"):
        s.time_rows(np.array([np.ones(5), row]), 1.0)
    assert (s.state == untouched.state).all()


@pytest.mark.parametrize(
    ("P", "q", "why"),
    [
        (np.full((2, 2), np.nan), None, "finite"),
        (None, np.array([0.0, INF]), "finite"),
        (np.array([[1.0, 0.5], [0.0, 1.0]]), None, "not symmetric"),
        (np.diag([1.0, -1.0]), None, "indefinite"),
        (np.zeros((2, 2)), np.array([0.0, 1.0]), "unbounded"),
        (np.eye(3), None, "size"),
    ],
)
def test_data_that_are_refused_change_nothing(P, q, why):
    s, untouched = (recursive(np.eye(2), -np.ones(2)) for _ in range(2))
    with pytest.raises(ValueError, match=why):
        s.update(P, q)
    assert (s.solve() == untouched.solve()).all()
    for each in (s, untouched):
        each.append(np.array([1.0, 2.0]), 1.0)
    assert (s.solve() == untouched.solve()).all()
    s.update(q=np.zeros(2))
    assert (s.solve() == 0.0).all()


@pytest.mark.parametrize(
    ("settings_", "call", "sentence"),
    [
        ({"forgetting": 1.1}, None, "forgetting"),
        ({"weight": 0.0}, None, "weight"),
        ({"proximal": -1.0}, None, "proximal"),
        ({}, lambda s: s.append(np.ones(3), 1.0), "a row has 2 numbers"),
        ({}, lambda s: s.time_rows(np.ones((4, 2)), 1.0), r"rows must have shape \(N, 3\)"),
        ({}, lambda s: s.time_rows(np.ones((4, 3)), 0.9), "was set up with forgetting"),
    ],
)
def test_unusable_rows_and_settings_are_refused_in_one_sentence(settings_, call, sentence):
    with pytest.raises(ValueError, match=sentence):
        call(recursive(np.eye(2), np.zeros(2), **settings_))


def test_a_bounded_problem_whose_matrix_is_singular_is_solved():
    s = recursive(np.zeros((2, 2)), np.array([1.0, -1.0]), np.zeros(2), np.ones(2), proximal=0.0)
    assert s.solve().tolist() == [0.0, 1.0]
    s.append(np.array([1.0, 1.0]), -3.0)  # ½ (v₁ + v₂ − 3)² pulls v₁ up
    assert s.solve().tolist() == [1.0, 1.0]


@quick
@given(seed=seeds, d=st.integers(2, 20), cap=st.integers(1, 2))
def test_a_cap_of_exchanges_leaves_a_feasible_answer_and_zero_rows_lead_to_the_optimum(seed, d, cap):
    rng = np.random.default_rng(seed)
    lb, ub = random_bounds(rng, d)
    s = recursive(np.eye(d), rng.normal(size=d), lb, ub, proximal=0.0, most_exchanges=cap)
    for _ in range(20):
        row = 10 * rng.normal(size=d + 1)
        s.append(row[:-1], row[-1])
        assert inside(s.solve(), lb, ub)
    for _ in range(20 * d):
        s.append(np.zeros(d), 0.0)
        if s.solution().extras["status"] == "solved":
            break
    assert s.solution().found
    assert gap(s.problem(), s.solve()) < 1e-12


def test_the_solution_after_the_compiled_loop_is_that_of_its_last_start_and_not_of_the_row_before():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 6))
    s = recursive(A @ A.T, rng.normal(size=6), np.zeros(6), np.full(6, np.inf), most_exchanges=1)
    while s.solution().extras["status"] == "solved":
        s.append(10 * rng.normal(size=6), 10 * rng.normal())
    P, q = np.stack([A @ A.T, A @ A.T + np.eye(6)]), rng.normal(size=(2, 6))
    *_, answers = s.time_kernel(P, q)
    assert s.solution().extras["status"] == "solved"
    assert s.solution().found
    assert (s.solution().x == answers[1]).all()
