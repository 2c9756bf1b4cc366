"""The judge: the same measures of accuracy for every solver, from the problem's data and not from the solver's report.

- cost gap        (V(x̂) − V*) / (V* + c) in exact arithmetic, x̂ the feasible point nearest to the answer x; over
                  max(½ x*ᵀP x*, |qᵀx*|) if the cost of the program is not a sum of squares
- violation       ‖x − x̂‖∞ / ‖x*‖∞
- residuals       primal, dual and duality gap as qpsolvers.Solution defines them, from the solver's own duals
- weight error    ‖w − w*‖∞ / ‖w*‖∞ in weight coordinates and normalised units; NaN if w* is zero or not unique
- model error     RMS error of the model on unseen data, in per cent of the output's range
- stage excess    (model error − that of x*) / standard deviation of the sensor's noise; NaN if either is unknown

`bench.derived.tiers` defines the tiers by these measures.
"""

import math

import numpy as np
from qpsolvers import Solution

from bench.derived.tiers import TOLERANCE
from bench.messages.solver_info import amount
from bench.messages.task import Outcome, Row, Status
from bench.problems.fresh import FreshData
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.race_table import MISSES
from piezo_model.identification_problem import Scaling
from solvers.arrays import Index, Matrix, Vector, product
from solvers.certificate import exact_cost_gap


def judge_timed(problem: RaceProblem, fresh: FreshData, calls: Index, answers: Matrix, few: int) -> Row:
    """Columns of the timed answers (n, d) to the data of these calls (n,): how many were judged, how many of them miss
    each tolerance, and the worst of them with the draw of its data, as of ``FreshData.draw``, from which it can be
    judged again.

    An answer is judged in floating point where the bounds of its error exclude every tolerance; of the others at most
    ``few``, drawn in secret, are judged in exact arithmetic. ``timed_gap`` is the larger of cost gap and violation,
    infinite if the answer is not finite. ``timed_stage_excess`` is as of a first answer, beyond the model of the
    optimum to the same data.
    """
    low, high = fresh.gap_bounds(calls, answers)
    is_open = np.any([(low <= tolerance) & (high > tolerance) for tolerance in TOLERANCE.values()], axis=0)
    answer_of = dict(zip(map(int, calls), answers, strict=True))
    gaps = dict(zip(map(int, calls[~is_open]), high[~is_open], strict=True))
    for call in fresh.in_secret_order(calls[is_open])[:few]:
        if (proven := fresh.certified(call)) is not None:
            gaps[call] = max(relative_gap(proven, answer_of[call]))
    by_gap = sorted(gaps, key=lambda call: -gaps[call])
    worst, form = next(((call, form) for call in by_gap if (form := fresh.certified(call))), (-1, None))
    if form is None:
        return {}
    answer, shares, factors = (tuple(map(float, values)) for values in (answer_of[worst], *fresh.draw(worst)))
    return {
        "judged": len(gaps),
        "draw_seed": fresh.seed,
        **{name: sum(gap > TOLERANCE[tier] for gap in gaps.values()) for tier, name in MISSES.items()},
        **timed_measures(problem, form, answer_of[worst]),
        "timed_call": worst,
        "timed_answer": answer,
        "timed_shares": shares,
        "timed_factors": factors,
    }


def timed_measures(problem: RaceProblem, form: CertifiedForm, x: Vector) -> Row:
    """The measures of a timed answer (d,) to its own data."""
    gap, violation = relative_gap(form, x)
    excess = math.inf
    if np.isfinite(x).all():
        best = model_error(problem, form, np.array(form.certificate.x))
        excess = stage_excess(problem, model_error(problem, form, x), best)
    return {"timed_gap": max(gap, violation), "timed_violation": violation, "timed_stage_excess": excess}


def measures(problem: RaceProblem, form: CertifiedForm, x: Vector) -> Row:
    """The measures of a first answer (d,), which is finite."""
    (gap, violation), error = relative_gap(form, x), model_error(problem, form, x)
    return {
        "cost_gap": gap,
        "violation": violation,
        "weight_error": _weight_error(problem, form, x),
        "model_error_percent": error,
        "stage_excess": stage_excess(problem, error, problem.optimum_error_percent),
    }


def judge(problem: RaceProblem, scaling: Scaling, outcome: Outcome) -> Row:
    """Columns of an outcome; its status is answered if there is an answer to measure, whatever its solver says. The
    message quotes the solver if that is not found; of a failure, status and message are all."""
    if outcome.failure:
        return {"status": str(Status(outcome.failure)), "message": outcome.message}
    form = problem.forms[scaling]
    x, says = outcome.x, f"says {outcome.solver_status!r}"
    if x is None or x.shape != form.qp.q.shape or not np.all(np.isfinite(x)):
        return {
            "status": str(Status.MISSED if outcome.found else Status.SOLVER_FAILED),
            "message": f"{says}, and gives no finite answer of {form.qp.q.size} numbers",
        }
    bounds = form.qp.q if form.qp.lb is not None or form.qp.ub is not None else None
    for name, dual, primal in (
        ("y", outcome.y, form.qp.b),
        ("z", outcome.z, form.qp.h),
        ("z_box", outcome.z_box, bounds),
    ):
        if dual is not None and primal is not None and dual.shape != primal.shape:
            return {
                "status": str(Status.ADAPTER_FAILED),
                "message": f"duals {name}: expected shape {primal.shape}, got {dual.shape}",
            }
    solution = Solution(form.qp, x=x, y=outcome.y, z=outcome.z, z_box=outcome.z_box, found=True)
    return {
        "status": str(Status.ANSWERED),
        "message": "" if outcome.found else says,
        **measures(problem, form, x),
        **_residuals(solution),
    }


def relative_gap(form: CertifiedForm, x: Vector) -> tuple[float, float]:
    """Relative cost gap and violation of an answer (d,); infinite if it has NaN or infinity."""
    if not np.isfinite(x).all():
        return math.inf, math.inf
    gap = exact_cost_gap(form.qp, form.certificate, x, form.c)
    relative = gap.absolute / form.yardstick if form.cost_unit > 0.0 else gap.relative
    return relative, gap.violation / form.size


def stage_excess(problem: RaceProblem, error_percent: float, best_percent: float) -> float:
    """Model error beyond that of the optimum, in units of the sensor's noise."""
    v = problem.validation
    return (error_percent - best_percent) / 100.0 * v.span_um / v.noise_um if v and v.noise_um > 0.0 else math.nan


def _weight_error(problem: RaceProblem, form: CertifiedForm, x: Vector) -> float:
    best = problem.optimal_weights
    size = float(np.max(np.abs(best)))
    error = np.max(np.abs(product(form.to_weights, x) - best))
    return float(error) / size if form.optimum_is_unique and size > 0.0 else math.nan


def model_error(problem: RaceProblem, form: CertifiedForm, x: Vector) -> float:
    """Error of the model with the feasible weights nearest to an answer, of a program with bounds only."""
    v = problem.validation
    return v.error_percent(product(form.to_weights, np.clip(x, form.qp.lb, form.qp.ub))) if v else math.nan


def _residuals(solution: Solution) -> Row:
    """Primal and dual residual and duality gap by qpsolvers; NaN if the solver gave no duals for it."""
    problem = solution.problem
    bounded = problem.lb is not None or problem.ub is not None
    with np.errstate(over="ignore", invalid="ignore"):  # from an answer near the largest double
        primal, dual, gap = solution.primal_residual(), solution.dual_residual(), solution.duality_gap()
    if bounded and solution.z_box is None:  # since qpsolvers would leave the bounds out of the gap
        gap = math.inf
    return {"primal_residual": amount(primal), "dual_residual": amount(dual), "duality_gap": amount(gap)}
