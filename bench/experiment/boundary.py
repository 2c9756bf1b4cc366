"""The paper's Fig. 2: a trajectory of the projected difference equation meets the boundary of the admissible set.

The problem is a slice of the one that the experiment has just learned from: two of its scaled variables move and the others
stay at the optimum. With the partners w and v and the rest at *,

    minimise ½ zᵀ P_SS z + (q_S + P_SR z*_R)ᵀ z,   z = (w, v),   w ≥ 0

w is the variable that its bound holds back most strongly, v the free one that is coupled to it most strongly. The
trajectory starts inside, and is that of the registered solver, step by step with a step small enough to show the path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from qpsolvers import Problem

import solvers
from bench.experiment.style import HINDSIGHT, LEARNED, PALE, REFERENCE, STRAIGHT, Exhibit
from bench.rig.rig import Matrix, Vector, at_low_end
from bench.rig.trial import Trial
from piezo_model import DataBasis, IdentificationProblem

STEPS = 400
STEP_RATIO = 0.02
"""Of the stability limit 2/λ_max: small steps, so that the path is nearly that of the differential equation (7)."""
ARROWS = 7
ARROW_GAIN = 10.0


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
    rig = trial.rig
    basis = DataBasis(rig.structures[axis], at_low_end(rig.structures[axis]))
    q = trial.y @ rig.decoupling[axis]
    before = len(q) - rig.cycle
    basis.update(trial.x[:before, axis], q[:before], count=False)
    basis.update(trial.x[before:, axis], q[before:])
    return basis.problem()


def slice_of(problem: IdentificationProblem) -> Slice:
    """The two variables of the module; ValueError where no bound is active."""
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
    return Slice((names[held], names[free]), qp.P[np.ix_(pair, pair)], qp.q[pair] + qp.P[np.ix_(pair, rest)] @ z[rest],
                 qp.lb[pair], z[pair])


def trajectory(part: Slice, start: Vector, steps: int = STEPS, step_ratio: float = STEP_RATIO) -> tuple[Matrix, Matrix]:
    """Path (steps + 1, 2) of the solver from a start, and where each step would have gone without projection."""
    engine = solvers.get("projected_difference", step_ratio=step_ratio)
    engine.setup(Problem(part.P, part.q, lb=part.lb, ub=np.full(2, np.inf)))
    engine.begin(start)  # type: ignore[attr-defined]
    path = [np.array(start)]
    for _ in range(steps):
        engine.advance(1)  # type: ignore[attr-defined]
        path.append(np.array(engine.answer()))  # type: ignore[attr-defined]
    w = np.array(path)
    eta = 2.0 * step_ratio / float(np.linalg.eigvalsh(part.P)[-1])
    return w, w - eta * (w @ part.P + part.q)


def exhibit(trial: Trial) -> Exhibit:
    """Draw level lines, the admissible set and the trajectory, as deviations from the admissible optimum."""
    part = slice_of(problem_of(trial))
    unbounded = np.linalg.solve(part.P, -part.q)
    reach = float(part.lb[0] - unbounded[0])
    # Far out along the free variable and near the bound: the path meets the boundary early and has a way to go on it.
    start = part.optimum + reach * np.array([0.6, 2.0 * np.sign(part.P[0, 1])])
    w, free = trajectory(part, start)
    touched = w[:, 0] <= part.lb[0]
    first = int(np.argmax(touched))
    power = int(np.floor(np.log10(reach)))
    z, stepped, star = ((points - part.optimum) / 10.0**power for points in (w, free, unbounded))
    table = pd.DataFrame({"step": np.arange(len(w)), "w_held": w[:, 0], "w_free": w[:, 1], "unprojected_held": free[:, 0],
                          "unprojected_free": free[:, 1], "on_boundary": touched})

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        points = np.vstack([z, star])
        low, high = points.min(axis=0), points.max(axis=0)
        low, high = low - 0.15 * (high - low), high + 0.15 * (high - low)
        grid = np.stack(np.meshgrid(*(np.linspace(a, b, 200) for a, b in zip(low, high, strict=True))), axis=-1)
        height = 0.5 * np.einsum("ijk,kl,ijl->ij", grid - star, part.P, grid - star)
        axes.contour(grid[..., 0], grid[..., 1], height, np.geomspace(height.max() / 400, height.max(), 10), colors=PALE,
                     linewidths=0.8, zorder=1)
        axes.axvspan(low[0], 0.0, color=PALE, alpha=0.5, lw=0, zorder=0)
        axes.axvline(0.0, color=REFERENCE, lw=1.2, zorder=2)
        axes.plot(z[:, 0], z[:, 1], color=LEARNED, lw=2.0, zorder=4, label="projected difference equation")
        for k in spaced(z, np.flatnonzero(touched), ARROWS):
            axes.annotate("", z[k] + ARROW_GAIN * (stepped[k] - z[k]), z[k], zorder=3,
                          arrowprops={"arrowstyle": "->", "color": STRAIGHT, "shrinkA": 0, "shrinkB": 0})
        axes.plot([], [], color=STRAIGHT, marker="<", ms=4, label=f"its step before projection, times {ARROW_GAIN:g}")
        axes.plot(*z[0], marker="o", color=LEARNED, ls="", zorder=5)
        axes.annotate("start", z[0], (0, 8), textcoords="offset points", ha="center")
        axes.plot(0.0, 0.0, marker="*", ms=13, color=HINDSIGHT, ls="", zorder=6, label="admissible optimum")
        axes.plot(*star, marker="x", ms=8, color=REFERENCE, ls="", zorder=5, label="optimum without the bound")
        axes.annotate("not admissible", (low[0], low[1]), (6, 6), textcoords="offset points", color="#555555")
        axes.set(xlabel=f"{part.names[0]}, scaled, from its bound, $10^{{{power}}}$", xlim=(low[0], high[0]),
                 ylabel=f"{part.names[1]}, scaled, from the optimum, $10^{{{power}}}$", ylim=(low[1], high[1]), aspect="equal")
        axes.grid(visible=False)
        axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))

    distance = float(np.linalg.norm(w[-1] - part.optimum) / np.linalg.norm(start - part.optimum))
    sentence = (f"With {part.names[0]} and {part.names[1]} of the problem learned last, the trajectory meets the boundary at step "
                f"{first}, slides along it and has covered all but {distance:.1e} of its way after {STEPS} steps.")
    return Exhibit("fig2_boundary", "Fig. 2: the projected trajectory",
                   "A slice of the identification problem: level lines of the cost, the admissible set to the right of the bound, "
                   f"and the path of the solver at a step size of {STEP_RATIO:g} of the stability limit.", (sentence,), table,
                   draw, 5.0)


def spaced(path: Matrix, among: NDArray[np.intp], count: int) -> list[int]:
    """About ``count`` of the given samples of a path, evenly spaced along its way."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[among], axis=0), axis=1))])
    return sorted({int(among[np.argmin(np.abs(way - at))]) for at in np.linspace(0.0, way[-1], count)})
