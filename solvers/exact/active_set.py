"""The optimum of an exact quadratic program, from any guess of its active set.

A working set W is optimal when its stationary point breaks no constraint outside W and no inequality in W has λ < 0.
Otherwise W is repaired by methods that are certain to terminate:

- dual active set, for P ≻ 0: constraints of negative multiplier leave, then violated ones enter one by one while the
  multipliers stay nonnegative and the cost rises (D. Goldfarb, A. Idnani, "A numerically stable dual method for solving
  strictly convex quadratic programs", Math. Program. 27, 1983);
- criss-cross by least index, for singular P, starting from the dual active set of a strictly convex neighbour. It needs
  neither a feasible start nor a regular P, cannot cycle, and ends in an optimum, a contradiction or a ray (D. den
  Hertog, C. Roos, T. Terlaky, "The linear complementarity problem, sufficient matrices, and the criss-cross method",
  Linear Algebra Appl. 187, 1993).
"""

from collections.abc import Iterable, Sequence

from flint import fmpq, fmpq_mat, fmpz, fmpz_mat

from solvers.exact.linear_algebra import WORK, IntegerRows, OutOfWork, RationalColumn, Work, rational_column
from solvers.exact.program import (
    Constraint,
    ExactProgram,
    Infeasible,
    Kind,
    Point,
    Unbounded,
    stationary_point,
)


def optimum(program: ExactProgram, guess: Iterable[int], work: Work | None = None) -> tuple[list[int], Point]:
    """The working set and the point of an optimum, from guessed active constraints, the most certain first.

    Parameters
    ----------
    program : ExactProgram
        Its P is positive semidefinite; the caller proves it.
    guess : iterable of int
        Positions of constraints; may depend on each other.
    work : Work, optional
        Limit of the work on linear systems, WORK by default: criss-cross terminates, but can take long.

    Raises
    ------
    Infeasible, Unbounded
        With a constraint that proves it.
    OutOfWork
        The limit of the work is exceeded.
    """
    budget, W = work or Work(WORK), program.working_set(guess)
    if program.regular:
        return dual_active_set(program, W, budget)
    if _point(program, W, budget).wrong:
        neighbour = _strictly_convex_neighbour(program)
        W, _ = dual_active_set(neighbour, neighbour.working_set(W), budget)
    return criss_cross(program, program.working_set(W), budget)


def _point(program: ExactProgram, W: Sequence[int], budget: Work) -> Point:
    budget.spend(program.pivot_work(W))
    point = stationary_point(program, W)
    budget.known = f"P is convex, and the last active set breaks {len(point.wrong)} conditions"
    return point


def _contradiction(program: ExactProgram, k: int, others: Iterable[int]) -> Infeasible:
    against = ", ".join(str(program.constraint(r)) for r in others) or "nothing, since its row is zero"
    return Infeasible(f"the constraints contradict each other: {program.constraint(k)} against {against}")


def dual_active_set(program: ExactProgram, W: list[int], budget: Work) -> tuple[list[int], Point]:
    """The optimum of a program with P ≻ 0; raises :class:`Infeasible`."""
    W = [k for k in W if k < len(program.constraints)]  # P ≻ 0 needs no pins
    point = _point(program, W, budget)
    while pulling := {k for k in point.wrong if k in point.multipliers}:
        W = [k for k in W if k not in pulling]
        point = _point(program, W, budget)
    while point.wrong:
        k = max(point.wrong, key=lambda k: abs(point.slacks[k]) / program.constraint(k).size)
        W = _enter(program, k, W, point, budget)
        point = _point(program, W, budget)
    return W, point


def _enter(program: ExactProgram, k: int, W: Sequence[int], point: Point, budget: Work) -> list[int]:
    """Increase the multiplier of a violated constraint until it holds; constraints of W whose multiplier reaches zero
    on the way leave."""
    W, multipliers, excess = list(W), dict(point.multipliers), abs(point.slacks[k])
    side = 1 if point.slacks[k] < 0 else -1  # −1 for an equality that x undercuts
    normal = rational_column(program.constraint(k).row(program.d)) * fmpq(side)
    while True:
        # While the multiplier grows by t, x moves by −t·z, the multipliers of W by −t·u and the excess by −t·zᵀP z.
        budget.spend(program.pivot_work(W))
        z, u = program.kkt_solve(W, normal, [fmpq(0)] * len(W))
        fall = (normal.transpose() * z)[0, 0]
        limited = [r for r in W if u[r] > 0 and program.constraint(r).kind is not Kind.EQUALITY]
        first = min(limited, key=lambda r: multipliers[r] / u[r], default=None)
        if first is None or (fall != 0 and excess / fall <= multipliers[first] / u[first]):
            if fall == 0:
                raise _contradiction(program, k, [r for r in W if u[r] != 0])
            return [*W, k]
        step = multipliers[first] / u[first]
        excess -= step * fall
        W.remove(first)
        multipliers = {r: multipliers[r] - step * u[r] for r in W}


def _strictly_convex_neighbour(program: ExactProgram) -> ExactProgram:
    """The program with P_ii increased by one millionth, or by one millionth of the largest P_jj if P_ii is zero.

    Its optimum serves as a starting point only: it is near an optimum of the program, if that has one.
    """
    largest = max((program.P[i][i] for i in range(program.d)), default=fmpz(0)) or fmpz(1)
    P = [[entry * 10**6 for entry in row] for row in program.P]
    for i, row in enumerate(P):
        row[i] += program.P[i][i] or largest
    return ExactProgram(P, program.q * fmpq(10**6), program.constraints)


def criss_cross(program: ExactProgram, W: list[int], budget: Work) -> tuple[list[int], Point]:
    """Pivot on the wrong constraint of least index; raises :class:`Infeasible` or :class:`Unbounded`."""
    while (point := _point(program, W, budget)).wrong:
        step = _drop if point.wrong[0] in point.multipliers else _add
        W = step(program, point.wrong[0], W, point)
    return W, point


def _add(program: ExactProgram, k: int, W: Sequence[int], point: Point) -> list[int]:
    """Add a violated constraint, in exchange for one in W if it depends on W."""
    c = program.constraint(k)
    p, u = program.kkt_solve(W, rational_column(c.row(program.d)), [fmpq(0)] * len(W))
    if any(entry != 0 for entry in p.entries()):
        return [*W, k]
    # Here aₖ = Σ uᵣaᵣ over W. If no constraint of W can leave, every point that satisfies W violates k as much as x
    # does.
    side = 1 if point.slacks[k] < 0 else -1
    leaving = [r for r in W if program.constraint(r).refuses(-side * u[r])]
    if not leaving:
        raise _contradiction(program, k, [r for r in W if u[r] != 0])
    return [*(r for r in W if r != min(leaving)), k]


def _drop(program: ExactProgram, k: int, W: Sequence[int], point: Point) -> list[int]:
    """Drop a constraint whose multiplier has the wrong sign, in exchange for one outside W on a flat direction."""
    # p leaves constraint k, down the cost, along all others of W; its curvature pᵀP p is |uₖ|.
    inwards = fmpq(-1) if point.multipliers[k] < 0 else fmpq(1)
    p, u = program.kkt_solve(W, fmpq_mat(program.d, 1), [inwards if r == k else fmpq(0) for r in W])
    remaining = [r for r in W if r != k]
    if u[k] != 0:
        return remaining
    along_p = program.along(p)
    for r in point.slacks:
        if program.constraint(r).broken_by(-along_p[r]):
            return [*remaining, r]
    raise Unbounded(
        "the cost falls without bound along a direction that no constraint stops, away from the "
        f"{program.constraint(k)}"
    )


def nearest_feasible_point(
    program: ExactProgram, x: RationalColumn, work: Work | None = None
) -> tuple[ExactProgram, Point]:
    """The Euclidean projection of x (d, 1) on the feasible set as the optimum of a program with P = I and q = −x, and
    that program; raises :class:`Infeasible`, and OutOfWork."""
    identity = [[fmpz(int(i == j)) for j in range(program.d)] for i in range(program.d)]
    projection = ExactProgram(identity, -x, program.constraints)
    return projection, optimum(projection, program.violated(x), work)[1]


def _tight_rows(program: ExactProgram, point: Point) -> tuple[IntegerRows, IntegerRows]:
    """The rows of P and of the constraints that every optimum meets with equality, and those of the constraints that
    are tight at ``point`` with a multiplier of zero."""
    tight, weak = [list(row) for row in program.P], []
    for k, c in enumerate(program.constraints):
        if c.kind is Kind.EQUALITY or point.multipliers.get(k, 0) > 0:
            tight.append(c.row(program.d))
        elif k in point.multipliers or point.slacks[k] == 0:
            weak.append(c.row(program.d))
    return tight, weak


def is_unique_by_rank(program: ExactProgram, point: Point) -> bool:
    """Whether the equations that every optimum meets have rank d, which proves that ``point`` is the only one."""
    return bool(fmpz_mat(_tight_rows(program, point)[0]).rank() == program.d)


def uniqueness(program: ExactProgram, point: Point, work: Work) -> tuple[bool | None, RationalColumn | None]:
    """Whether the optimum at ``point`` is the only one, decided exactly, None if that takes more work than allowed; and
    a direction (d, 1) in which it can be left for another one.

    Another optimum lies along a direction p ≠ 0 with P p = 0 that keeps the equalities and the constraints of positive
    multiplier tight and does not break the other tight ones, aₖᵀp ≤ 0. No such direction exists if and only if all
    these rows have rank d and the linear program min Σ aₖᵀp over such p has the value 0.
    """
    d, (tight, weak) = program.d, _tight_rows(program, point)
    if fmpz_mat(tight).rank() == d:
        return True, None
    rows = fmpz_mat(tight + weak)
    if rows.rank() < d:
        kernel, _ = rows.nullspace()
        return False, fmpq_mat(fmpz_mat(d, 1, [kernel[i, 0] for i in range(d)]))
    total = [sum(entries, fmpz(0)) for entries in zip(*weak, strict=True)]
    cone = [Constraint(Kind.EQUALITY, i, fmpq(0), tuple(row)) for i, row in enumerate(tight)]
    cone += [Constraint(Kind.ROW, i, fmpq(0), tuple(row)) for i, row in enumerate(weak)]
    cone.append(Constraint(Kind.ROW, len(weak), fmpq(1), tuple(-entry for entry in total)))  # else the value is −∞
    no_curvature = [[fmpz(0)] * d for _ in range(d)]
    flat = ExactProgram(no_curvature, rational_column([fmpq(entry) for entry in total]), tuple(cone))
    try:
        p = optimum(flat, [], work)[1].x
    except OutOfWork:
        return None, None
    return (True, None) if flat.value(p) == 0 else (False, p)
