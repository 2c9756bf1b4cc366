"""The judge: residuals by the definitions of qpsolvers, statuses from the problem's data alone, and gaps of all timed
answers in floating point, whose bounds hold the exact ones and decide nearly always."""

import math
from dataclasses import replace

import numpy as np
import pytest
import qpsolvers
from measured_rows import form_of, is_right, judged
from qpsolvers import Problem

from bench.derived.tiers import TOLERANCE
from bench.messages.task import Outcome, Status, Tier
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem, Window
from bench.problems.simulation import Experiment
from bench.race_table import MISSES
from bench.races.metrics import judge_timed, relative_gap
from piezo_model import HysteresisCreepModel

C = 40.0
"""Constant term, which makes the relative gap finite."""


def race_problem(qp: Problem) -> RaceProblem:
    return RaceProblem("tests", "one", {"scaled": form_of(qp, C)})


def drawn(seed: int, d: int = 6, rows: bool = False) -> Problem:
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(2 * d, d))
    general = {"G": rng.normal(size=(3, d)), "h": np.full(3, 0.1), "A": rng.normal(size=(1, d)), "b": np.array([0.2])}
    return Problem(
        M.T @ M, rng.normal(size=d) * 5.0, lb=np.full(d, -0.5), ub=np.full(d, 0.7), **(general if rows else {})
    )


BOX = race_problem(drawn(0))
BEST = np.array(BOX.forms["scaled"].certificate.x)


def answered(x: np.ndarray, **more: object) -> Outcome:
    return replace(Outcome(found=True, x=x, solver_status="solved"), **more)


@pytest.mark.parametrize("rows", [False, True])
def test_residuals_are_those_of_qpsolvers(rows: bool) -> None:
    qp = drawn(1, rows=rows)
    found = qpsolvers.solve_problem(qp, solver="daqp")
    ours = judged(race_problem(qp), "scaled", answered(found.x, y=found.y, z=found.z, z_box=found.z_box))
    assert (ours.primal_residual, ours.dual_residual, ours.duality_gap) == (
        found.primal_residual(),
        found.dual_residual(),
        found.duality_gap(),
    )


@pytest.mark.parametrize("duals", [{}, {"z_box": np.full(6, np.nan)}], ids=["without duals", "not finite"])
def test_without_finite_duals_residuals_are_missing_and_not_zero_and_the_answer_is_right(duals: dict) -> None:
    ours = judged(BOX, "scaled", answered(BEST, **duals))
    assert (ours.status, ours.primal_residual) == (Status.ANSWERED, 0.0)
    assert np.isnan([ours.dual_residual, ours.duality_gap]).all()


@pytest.mark.parametrize("gap", [2e-3, 0.5e-12])
def test_a_cost_gap_is_relative_to_the_optimal_cost_with_its_constant(gap: float) -> None:
    qp = BOX.forms["scaled"].qp
    free = int(np.flatnonzero((qp.lb < BEST) & (qp.ub > BEST))[0])
    value, x = 0.5 * BEST @ qp.P @ BEST + qp.q @ BEST + C, BEST.copy()
    x[free] += np.sqrt(2.0 * gap * abs(value) / qp.P[free, free])  # V(x* + t e) − V* = ½ P_ee t², since e is free
    ours = judged(BOX, "scaled", answered(x))
    assert (ours.status, ours.message) == (Status.ANSWERED, "")
    assert ours.cost_gap == pytest.approx(gap, rel=1e-4, abs=0.0)
    assert ours.weight_error == pytest.approx(abs(x - BEST).max() / abs(BEST).max())


@pytest.mark.parametrize("violation", [2e-3, 0.5e-12])
def test_a_violation_is_relative_to_the_largest_variable_of_the_optimum(violation: float) -> None:
    bound = int(np.flatnonzero(BOX.forms["scaled"].qp.lb == BEST)[0])
    x = BEST.copy()
    x[bound] -= violation * abs(BEST).max()
    ours = judged(BOX, "scaled", answered(x))
    assert ours.violation == pytest.approx(violation, rel=1e-3, abs=0.0)
    assert ours.primal_residual == pytest.approx(ours.violation * abs(BEST).max())


def test_the_stage_excess_is_the_error_of_the_model_beyond_the_optimums_in_units_of_the_noise() -> None:
    problem = Experiment("bouc_wen", "multi_sine", build_s=1.0).problem("tests", "stage")
    form, unseen = problem.forms["scaled"], problem.validation
    best = np.array(form.certificate.x)
    same, worse = (judged(problem, "scaled", answered(x)).stage_excess for x in (best, 1.05 * best))
    model = HysteresisCreepModel.from_weights(unseen.structure, form.to_weights @ (1.05 * best))
    error_um = model.simulate(unseen.x, unseen.state) - unseen.y
    optimum_um = problem.optimum_error_percent / 100.0 * np.ptp(unseen.y)
    assert same == pytest.approx(0.0, abs=1e-9)
    assert worse == pytest.approx((np.sqrt(np.mean(error_um**2)) - optimum_um) / unseen.noise_um)


@pytest.mark.parametrize("size", [1e30, 1e150, 1e300, -1e308])
def test_an_absurd_finite_answer_reaches_no_tier(size: float) -> None:
    ours = judged(BOX, "scaled", answered(np.full(6, size)))
    assert not any(is_right(ours, tier) for tier in Tier)
    assert ours.violation > 1e29


UNMEASURED = (
    *(np.where(np.arange(6) == 2, bad, BEST) for bad in (np.nan, np.inf, -np.inf)),
    *(None, np.zeros(0), np.zeros(5), np.zeros((6, 1)), np.array(np.nan)),
)
NO_ANSWER = "says 'solved', and gives no finite answer of 6 numbers"


@pytest.mark.parametrize(
    ("outcome", "status", "message", "right"),
    [
        *((answered(x), Status.MISSED, NO_ANSWER, False) for x in UNMEASURED),
        *((answered(x, found=False), Status.SOLVER_FAILED, NO_ANSWER, False) for x in UNMEASURED),
        *(
            (answered(x, found=False, solver_status="gave up"), Status.ANSWERED, "says 'gave up'", right)
            for x, right in ((BEST, True), (BEST + 1.0, False))
        ),
        *(
            (Outcome(str(status), "said why"), status, "said why", False)
            for status in (
                Status.UNSUPPORTED,
                Status.ADAPTER_FAILED,
                Status.CRASHED,
                Status.TIMED_OUT,
                Status.OUT_OF_MEMORY,
            )
        ),
    ],
)
def test_an_answer_is_judged_whatever_the_solver_calls_it_and_what_cannot_be_measured_is_missed_or_failed(
    outcome: Outcome, status: Status, message: str, right: bool
) -> None:
    ours = judged(BOX, "scaled", outcome)
    assert (ours.status, ours.message, is_right(ours, Tier.HIGH)) == (status, message, right)
    assert np.isnan(ours.cost_gap) == (status is not Status.ANSWERED)


@pytest.mark.parametrize(("name", "primal"), [("y", "b"), ("z", "h"), ("z_box", "q")])
def test_duals_of_another_shape_are_a_failure_of_the_adapter(name: str, primal: str) -> None:
    problem = race_problem(drawn(1, rows=True))
    form = problem.forms["scaled"]
    ours = judged(problem, "scaled", answered(np.array(form.certificate.x), **{name: np.zeros(7)}))
    assert (ours.status, ours.message) == (
        Status.ADAPTER_FAILED,
        f"duals {name}: expected shape {getattr(form.qp, primal).shape}, got (7,)",
    )


N = 40


def least_squares(seed: int, d: int, condition: float, cost_unit: float = 0.0) -> CertifiedForm:
    """A least-squares program with a window beside it, or one from a file if it has a unit of cost."""
    rng = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(rng.normal(size=(3 * d, d)))
    A = Q * condition ** (-np.arange(d) / (2.0 * max(d - 1, 1))) @ np.linalg.qr(rng.normal(size=(d, d)))[0]
    A *= 10.0 ** rng.uniform(-2.0, 2.0, d)  # units
    y, z = (A @ np.abs(rng.normal(size=d) / A.std(axis=0)) + 1e-2 * rng.normal(size=3 * d) for _ in range(2))
    qp = Problem(A.T @ A, -A.T @ y, lb=np.zeros(d), ub=np.where(rng.random(d) < 0.5, np.inf, 1.0 / A.std(axis=0)))
    windows = () if cost_unit else (Window(A.T @ A, -A.T @ z, float(z @ z) / 2.0),)
    return form_of(qp, 0.0 if cost_unit else float(y @ y) / 2.0, cost_unit=cost_unit, windows=windows)


@pytest.mark.parametrize("cost_unit", [0.0, 1.0])
@pytest.mark.parametrize("condition", [1e1, 1e6, 1e10])
@pytest.mark.parametrize("d", [1, 5, 18])
def test_the_bounds_hold_the_exact_gap_and_exclude_nearly_every_tolerance(
    d: int, condition: float, cost_unit: float
) -> None:
    form = least_squares(d, d, condition, cost_unit)
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
    singular = least_squares(1, 3, 10.0, cost_unit=1.0)
    singular.qp.P[:] = 1.0
    rows = least_squares(2, 3, 10.0)
    rows.qp.G, rows.qp.h = np.ones((1, 3)), np.full(1, 1e6)
    for form in (singular, rows):
        low, high = FreshData(form, 4, 0).gap_bounds(np.arange(4), np.zeros((4, 3)))
        assert (low.tolist(), high.tolist()) == ([0.0] * 4, [math.inf] * 4)
    low, _ = FreshData(least_squares(3, 3, 10.0), 2, 0).gap_bounds(
        np.arange(2), np.array([[0.0, np.nan, 0.0], [np.inf, 0.0, 0.0]])
    )
    assert (low == math.inf).all()


@pytest.mark.parametrize("wrong", [0, 1, 150, 298, 299])
def test_a_single_wrong_answer_among_all_timed_ones_is_found_wherever_it_is(wrong: int) -> None:
    form = least_squares(4, 6, 1e3)
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


def test_the_draw_of_all_data_is_made_again_from_its_seed_and_proofs_are_made_of_calls_at_random() -> None:
    form, calls = least_squares(5, 4, 10.0), np.arange(30)
    first = FreshData(form, 30)
    one, other = first.in_secret_order(calls), FreshData(form, 30).in_secret_order(calls)
    assert {*one} == {*other} == {*calls}
    assert one != other
    assert all(map(np.array_equal, first.block(0, 30), FreshData(form, 30, first.seed).block(0, 30)))
