"""The paper's Fig. 2: a trajectory of the projected difference equation meets the boundary of the admissible set.

The problem is a slice of the last program of a learning stage: two of its scaled variables, w and v, are free and the
rest R stay at the optimum z*. With S for the two variables,

    minimise ½ zᵀ P_SS z + (q_S + P_SR z*_R)ᵀ z,   z = (w, v),   w ≥ 0

w is the variable with the largest multiplier of its bound, v the inactive one with the strongest coupling to w. The
trajectory starts in the interior and is that of the registered solver, with a step small enough to show the path.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from outputs import arguments, show
from qpsolvers import Problem
from two_axis_stage import Trial, learned, setup_of

import solvers
from bench.report.report import GREY, INK, PALETTE, Axis, Figure, Mark, Plot
from piezo_model import DataBasis, IdentificationProblem
from solvers.arrays import Matrix, Vector

STEPS = 400
STEP_RATIO = 0.02
"""Step as a share of the stability limit 2/λ_max: so small that the path is nearly that of equation (7)."""
ARROWS = 7
ARROW_GAIN = 10.0
LEVELS = 10
WIDTH = 780
"""Width of the picture in pixels."""
BLUE, RED, GREEN = PALETTE[:3]


@dataclass(frozen=True)
class Slice:
    """Two variables of a problem, the first one bounded from below at the optimum."""

    names: tuple[str, str]
    P: Matrix
    q: Vector
    lb: Vector
    optimum: Vector


def problem_of(trial: Trial, axis: int = 0) -> IdentificationProblem:
    """The program (6) of one axis over the last cycle of a trial."""
    setup = trial.setup
    basis = DataBasis(setup.structures[axis])  # the axis was at rest
    q = trial.y @ setup.decoupling[axis]
    before = len(q) - setup.cycle
    basis.update(trial.x[:before, axis], q[:before], count=False)
    basis.update(trial.x[before:, axis], q[before:])
    return basis.problem()


def slice_of(problem: IdentificationProblem) -> Slice:
    """The slice of a problem; ValueError if no bound is active."""
    qp = problem.qp
    engine = solvers.get("box_active_set")
    engine.setup(qp)
    z = np.array(engine.solve())
    pull = np.where(problem.reached & (z <= qp.lb), qp.P @ z + qp.q, 0.0)
    if not pull.max() > 0.0:
        raise ValueError("no bound is active at the optimum, so no trajectory meets the boundary")
    held = int(np.argmax(pull))
    weights = problem.reached & np.isfinite(qp.lb)  # all but the offset
    free = int(np.argmax(np.where((z > qp.lb) & weights, np.abs(qp.P[held]), -1.0)))
    pair = np.array([held, free])
    rest = np.setdiff1d(np.arange(z.size), pair)
    names = problem.structure.weight_names
    return Slice(
        (names[held], names[free]),
        qp.P[np.ix_(pair, pair)],
        qp.q[pair] + qp.P[np.ix_(pair, rest)] @ z[rest],
        qp.lb[pair],
        z[pair],
    )


def trajectory(part: Slice, start: Vector, steps: int = STEPS, step_ratio: float = STEP_RATIO) -> tuple[Matrix, Matrix]:
    """Path (steps + 1, 2) of the solver from a start, and the end of each step before its projection."""
    engine = solvers.get("projected_difference", step_ratio=step_ratio, steps=1)
    engine.setup(Problem(part.P, part.q, lb=part.lb, ub=np.full(2, np.inf)))
    path = [np.array(start)]
    for _ in range(steps):
        path.append(engine.solve(path[-1]))
    w = np.array(path)
    eta = 2.0 * step_ratio / float(np.linalg.eigvalsh(part.P)[-1])
    return w, w - eta * (w @ part.P + part.q)


def figure(part: Slice) -> tuple[Figure, str]:
    """Level lines, admissible set and trajectory relative to the admissible optimum, and a sentence about them."""
    unbounded = np.linalg.solve(part.P, -part.q)
    reach = float(part.lb[0] - unbounded[0])
    # Far from the optimum along the free variable and near the bound: the path meets the boundary early and follows it.
    start = part.optimum + reach * np.array([0.6, 2.0 * np.sign(part.P[0, 1])])
    w, unprojected = trajectory(part, start)
    touched = w[:, 0] <= part.lb[0]
    first, power = int(np.argmax(touched)), int(np.floor(np.log10(reach)))
    z, stepped, star = ((points - part.optimum) / 10.0**power for points in (w, unprojected, unbounded))
    points = np.vstack([z, star])
    margin = 0.15 * np.ptp(points, axis=0)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin

    arrows = {
        f"step {k}": np.array([z[k], z[k] + ARROW_GAIN * (stepped[k] - z[k])])
        for k in spaced(z, np.flatnonzero(touched), ARROWS)
    }
    ends = {"start": z[0], "admissible optimum": np.zeros(2), "optimum without the bound": star}
    drawn = [
        *(("level", f"level {i}", line) for i, line in enumerate(level_lines(part.P, star, low, high))),
        ("bound", "bound", np.array([[0.0, low[1]], [0.0, high[1]]])),
        ("unprojected", "unprojected", stepped),
        *(("step", name, line) for name, line in arrows.items()),
        ("path", "path", z),
        *(("point", name, at[None, :]) for name, at in ends.items()),
    ]
    table = pd.concat(
        [
            pd.DataFrame(
                {"kind": kind, "name": name, "step": np.arange(len(line)), "held": line[:, 0], "free": line[:, 1]}
            )
            for kind, name, line in drawn
        ],
        ignore_index=True,
    )
    marks = [
        Mark("line", where={"kind": [kind]}, colour=colour, size=size, along="step")
        for kind, colour, size in (("level", GREY, 0.8), ("bound", INK, 1.2), ("step", RED, 1.2), ("path", BLUE, 2.0))
    ]
    # equal scales: gradients are normal to level lines
    equal = round(WIDTH * float((high[1] - low[1]) / (high[0] - low[0])))
    plot = Plot(
        Axis("held", f"{part.names[0]}, scaled, from its bound, 1e{power}", domain=(low[0], high[0])),
        Axis("free", f"{part.names[1]}, scaled, from the optimum, 1e{power}", domain=(low[1], high[1])),
        (*marks, Mark("point", "name", where={"kind": ["point"]}, size=80.0)),
        ("name",),
        height=equal,
        colours=dict(zip(ends, (BLUE, GREEN, INK), strict=True)),
    )
    distance = float(np.linalg.norm(w[-1] - part.optimum) / np.linalg.norm(start - part.optimum))
    return Figure(
        "fig2_boundary",
        "Fig. 2: the projected trajectory",
        "A slice of the identification problem: level lines of the cost, the admissible set to the right of "
        "the bound, "
        f"the path of the solver at a step size of {STEP_RATIO:g} of the stability limit, and some steps "
        "before projection, "
        f"{ARROW_GAIN:g} times as long.",
        table,
        [plot],
    ), (
        f"With {part.names[0]} and {part.names[1]} of the problem learned last, the trajectory meets the boundary at "
        "step "
        f"{first}, slides along it and has covered all but {distance:.1e} of its way after {STEPS} steps."
    )


def level_lines(P: Matrix, centre: Vector, low: Vector, high: Vector) -> list[Matrix]:
    """Level lines of ½ (z − c)ᵀ P (z − c) in a window, evenly spaced on a logarithmic scale: with P = L Lᵀ and the
    height h

        z = c + √(2h) L⁻ᵀ (cos t, sin t)
    """
    corners = np.array([(a, b) for a in (low[0], high[0]) for b in (low[1], high[1])]) - centre
    highest = float(0.5 * np.einsum("ij,jk,ik->i", corners, P, corners).max())
    t = np.linspace(0.0, 2.0 * np.pi, 721)
    ellipse = np.linalg.solve(np.linalg.cholesky(P).T, np.array([np.cos(t), np.sin(t)])).T
    lines = [centre + np.sqrt(2.0 * height) * ellipse for height in np.geomspace(highest / 400.0, highest, LEVELS)]
    return [
        np.where(np.all((z > low - (high - low)) & (z < high + (high - low)), axis=1, keepdims=True), z, np.nan)
        for z in lines
    ]


def spaced(path: Matrix, among: NDArray[np.intp], count: int) -> list[int]:
    """About ``count`` of the given samples of a path, evenly spaced in arc length."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[among], axis=0), axis=1))])
    return sorted({int(among[np.argmin(np.abs(length - at))]) for at in np.linspace(0.0, length[-1], count)})


def main() -> None:
    """Let a stage learn, and draw a trajectory of its last problem."""
    given = arguments(quick=False, seed=0)
    drawn, sentence = figure(slice_of(problem_of(learned(setup_of(given, solver="box_active_set")))))
    show(drawn, [sentence], given.out)


if __name__ == "__main__":
    main()
