"""Gaps in floating point: their bounds hold the exact gaps, decide nearly always, and all timed answers are judged."""

import math

import numpy as np
import pytest
from qpsolvers import Problem

from bench.derived.tiers import TOLERANCE
from bench.messages.task import Tier
from bench.problems.fresh import FreshData, mixture
from bench.problems.protocol import CertifiedForm, RaceProblem, Window
from bench.race_table import MISSES
from bench.races.metrics import judge_timed, relative_gap
from solvers.certificate import certify

N = 40


def drawn(seed: int, d: int, condition: float, cost_unit: float = 0.0) -> CertifiedForm:
    """A least-squares program with a window beside it, or one from a file if it has a unit of cost."""
    rng = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(rng.normal(size=(3 * d, d)))
    A = Q * condition ** (-np.arange(d) / (2.0 * max(d - 1, 1))) @ np.linalg.qr(rng.normal(size=(d, d)))[0]
    A *= 10.0 ** rng.uniform(-2.0, 2.0, d)  # units
    y, z = (A @ np.abs(rng.normal(size=d) / A.std(axis=0)) + 1e-2 * rng.normal(size=3 * d) for _ in range(2))
    qp = Problem(A.T @ A, -A.T @ y, lb=np.zeros(d), ub=np.where(rng.random(d) < 0.5, np.inf, 1.0 / A.std(axis=0)))
    windows = () if cost_unit else (Window(A.T @ A, -A.T @ z, float(z @ z) / 2.0),)
    c = 0.0 if cost_unit else float(y @ y) / 2.0
    return CertifiedForm(qp, c, np.eye(d), certify(qp, np.zeros(d)), cost_unit=cost_unit, windows=windows)


@pytest.mark.parametrize("cost_unit", [0.0, 1.0])
@pytest.mark.parametrize("condition", [1e1, 1e6, 1e10])
@pytest.mark.parametrize("d", [1, 5, 18])
def test_the_bounds_hold_the_exact_gap_and_exclude_nearly_every_tolerance(
    d: int, condition: float, cost_unit: float
) -> None:
    form = drawn(d, d, condition, cost_unit)
    fresh, rng = FreshData(form, N, 7), np.random.default_rng(8)
    answers = np.array([fresh.certified(call).certificate.x for call in range(N)])
    # off by 1e-16 to 1e-1, some of them outside the bounds
    off = 10.0 ** rng.uniform(-16, -1, (N, 1)) * np.abs(answers).max(axis=1, keepdims=True)
    answers += off * rng.normal(size=answers.shape)
    exact = np.array([max(relative_gap(fresh.certified(call), answers[call])) for call in range(N)])
    low, high = fresh.gap_bounds(np.arange(N), answers)
    assert ((low <= exact) & (exact <= high)).all()
    is_open = [(low <= tolerance) & (high > tolerance) for tolerance in (1e-3, 1e-6, 1e-9)]
    assert np.any(is_open, axis=0).sum() <= N // 10


def test_nothing_is_known_of_a_singular_program_and_one_with_rows_and_nan_is_infinitely_wrong() -> None:
    singular = drawn(1, 3, 10.0, cost_unit=1.0)
    singular.qp.P[:] = 1.0
    rows = drawn(2, 3, 10.0)
    rows.qp.G, rows.qp.h = np.ones((1, 3)), np.full(1, 1e6)
    for form in (singular, rows):
        bounds = FreshData(form, 4, 0).gap_bounds(np.arange(4), np.zeros((4, 3)))
        np.testing.assert_array_equal(bounds, np.repeat([[0.0], [math.inf]], 4, axis=1))
    low, _ = FreshData(drawn(3, 3, 10.0), 2, 0).gap_bounds(
        np.arange(2), np.array([[0.0, np.nan, 0.0], [np.inf, 0.0, 0.0]])
    )
    assert (low == math.inf).all()


@pytest.mark.parametrize("wrong", [0, 1, 150, 298, 299])
def test_a_single_wrong_answer_among_all_timed_ones_is_found_wherever_it_is(wrong: int) -> None:
    form = drawn(4, 6, 1e3)
    fresh = FreshData(form, 300)
    calls = np.delete(np.arange(300), 7)  # as a solver that missed a sample
    answers = np.array([fresh.certified(int(call)).certificate.x for call in calls])
    answers[calls == wrong] *= 1.0 + 1e-4
    row = judge_timed(RaceProblem("none", "none", {"scaled": form}), fresh, calls, answers, 0)
    assert (row["judged"], row["timed_call"], row["draw_seed"]) == (299, wrong, fresh.seed)
    gap = max(relative_gap(fresh.certified(wrong), np.array(row["timed_answer"])))
    assert row["timed_gap"] == gap
    assert {tier: row[name] for tier, name in MISSES.items()} == {tier: int(gap > TOLERANCE[tier]) for tier in MISSES}
    assert row[MISSES[Tier.HIGH]] == 1


def test_a_program_without_windows_keeps_every_bit_of_its_p() -> None:
    form = drawn(6, 4, 1e3, cost_unit=1.0)
    fresh = FreshData(form, 100)
    assert fresh.block(0, 100)[0] is None
    assert all(mixture(form, *fresh.draw(call)).qp.P.tobytes() == form.qp.P.tobytes() for call in range(100))


def test_the_draw_of_all_data_is_made_again_from_its_seed_and_proofs_are_made_of_calls_at_random() -> None:
    form, calls = drawn(5, 4, 10.0), np.arange(30)
    first = FreshData(form, 30)
    one, other = first.in_secret_order(calls), FreshData(form, 30).in_secret_order(calls)
    assert {*one} == {*other} == {*calls}
    assert one != other
    for mine, again in zip(first.block(0, 30), FreshData(form, 30, first.seed).block(0, 30), strict=True):
        assert np.array_equal(mine, again)
