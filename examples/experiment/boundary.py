"""The paper's Fig. 2: a trajectory of the projected difference equation meets the boundary of the admissible set.

The problem is a slice of the one that a stage has just learned from: two of its scaled variables move and the others
stay at the optimum. With the partners w and v and the rest at *,

    minimise ½ zᵀ P_SS z + (q_S + P_SR z*_R)ᵀ z,   z = (w, v),   w ≥ 0

w is the variable that its bound holds back most strongly, v the free one that is coupled to it most strongly. The
trajectory starts inside, and is that of the registered solver, step by step with a step small enough to show the path.
"""

from __future__ import annotations

from dataclasses import dataclass

import altair as alt
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from outputs import arguments, rig_of, show
from qpsolvers import Problem

import solvers
from bench.experiment.plots import HINDSIGHT, LEARNED, PALE, REFERENCE, STRAIGHT, Line, axis, plot
from bench.report.charts import data
from bench.report.report import Figure
from bench.rig.rig import at_low_end
from bench.rig.trial import Trial, learned
from piezo_model import DataBasis, IdentificationProblem
from solvers.arrays import Matrix, Vector

STEPS = 400
STEP_RATIO = 0.02
"""Of the stability limit 2/λ_max: small steps, so that the path is nearly that of the differential equation (7)."""
ARROWS = 7
ARROW_GAIN = 10.0
LEVELS = 10
WIDE = 380
"""Pixels."""
STAR = "M0,-1L0.225,-0.309L0.951,-0.309L0.363,0.118L0.588,0.809L0,0.382L-0.588,0.809L-0.363,0.118L-0.951,-0.309L-0.225,-0.309Z"


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


def figure(part: Slice) -> tuple[Figure, str]:
    """Draw level lines, the admissible set and the trajectory, as deviations from the admissible optimum, and say how far it comes."""
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

    points = np.vstack([z, star])
    low, high = points.min(axis=0), points.max(axis=0)
    low, high = low - 0.15 * (high - low), high + 0.15 * (high - low)
    tall = round(WIDE * float((high[1] - low[1]) / (high[0] - low[0])))  # equal scales: gradients are normal to level lines
    x = axis(f"{part.names[0]}, scaled, from its bound, 1e{power}", domain=[low[0], high[0]])
    y = axis(f"{part.names[1]}, scaled, from the optimum, 1e{power}", domain=[low[1], high[1]])

    tips = pd.DataFrame([{"x": z[k, 0], "y": z[k, 1], "to_x": tip[0], "to_y": tip[1],
                          "angle": 90.0 - np.degrees(np.arctan2(tip[1] - z[k, 1], tip[0] - z[k, 0]))}
                         for k in spaced(z, np.flatnonzero(touched), ARROWS)
                         for tip in (z[k] + ARROW_GAIN * (stepped[k] - z[k]),)])
    arrows = alt.Chart(data(tips))
    bound = Line("bound", np.zeros(2), np.array([low[1], high[1]]), REFERENCE)
    path = Line("path", z[:, 0], z[:, 1], LEARNED, width=2.0)
    marks = pd.DataFrame([
        ("projected difference equation", *z[0], LEARNED, "circle", 60, "start"),
        (f"its step before projection, times {ARROW_GAIN:g}", *tips[["to_x", "to_y"]].iloc[0], STRAIGHT, "triangle-left", 0, ""),
        ("admissible optimum", 0.0, 0.0, HINDSIGHT, STAR, 250, ""),
        ("optimum without the bound", *star, REFERENCE, "cross", 70, "")],
        columns=["mark", "x", "y", "colour", "shape", "size", "word"])
    names, key = marks["mark"].tolist(), alt.Legend(columns=2, labelLimit=300)
    marked = alt.Chart(data(marks)).encode(x="x:Q", y="y:Q")
    corner = alt.Chart(data(pd.DataFrame({"x": [low[0]], "y": [low[1]]}))).encode(x="x:Q", y="y:Q")
    chart = alt.layer(
        alt.Chart(data(pd.DataFrame({"x": [low[0]], "x2": [0.0]}))).mark_rect(color=PALE, opacity=0.5).encode(x="x:Q", x2="x2:Q"),
        plot([*level_lines(part.P, star, low, high), bound, path], x, y, WIDE, tall, legend=False),
        arrows.mark_rule(color=STRAIGHT, clip=True).encode(x="x:Q", y="y:Q", x2="to_x:Q", y2="to_y:Q"),
        arrows.mark_point(shape="triangle", filled=True, color=STRAIGHT, opacity=1.0, size=40, clip=True).encode(
            x="to_x:Q", y="to_y:Q", angle=alt.Angle("angle:Q", scale=None)),
        marked.mark_point(filled=True, opacity=1.0).encode(
            color=alt.Color("mark:N", scale=alt.Scale(domain=names, range=marks.colour.tolist()), legend=key),
            shape=alt.Shape("mark:N", scale=alt.Scale(domain=names, range=marks["shape"].tolist()), legend=key),
            size=alt.Size("size:Q", scale=None, legend=None)),
        marked.mark_text(dy=-12).encode(text="word:N"),
        corner.mark_text(align="left", dx=6, dy=-8, color="#555555").encode(text=alt.value("not admissible")),
    ).resolve_scale(color="independent", shape="independent")

    distance = float(np.linalg.norm(w[-1] - part.optimum) / np.linalg.norm(start - part.optimum))
    sentence = (f"With {part.names[0]} and {part.names[1]} of the problem learned last, the trajectory meets the boundary at step "
                f"{first}, slides along it and has covered all but {distance:.1e} of its way after {STEPS} steps.")
    return Figure("fig2_boundary", "Fig. 2: the projected trajectory",
                  "A slice of the identification problem: level lines of the cost, the admissible set to the right of the bound, "
                  f"and the path of the solver at a step size of {STEP_RATIO:g} of the stability limit.", table, [chart]), sentence


def level_lines(P: Matrix, centre: Vector, low: Vector, high: Vector) -> list[Line]:
    """Level lines of ½ (z − c)ᵀ P (z − c) in a window, evenly spaced on a logarithmic scale: with P = L Lᵀ and the height h

        z = c + √(2h) L⁻ᵀ (cos t, sin t)
    """
    corners = np.array([(a, b) for a in (low[0], high[0]) for b in (low[1], high[1])]) - centre
    highest = float(0.5 * np.einsum("ij,jk,ik->i", corners, P, corners).max())
    t = np.linspace(0.0, 2.0 * np.pi, 721)
    ellipse = np.linalg.solve(np.linalg.cholesky(P).T, np.array([np.cos(t), np.sin(t)])).T
    lines = []
    for height in np.geomspace(highest / 400.0, highest, LEVELS):
        z = centre + np.sqrt(2.0 * height) * ellipse
        near = np.all((z > low - (high - low)) & (z < high + (high - low)), axis=1, keepdims=True)
        shown = np.where(near, z, np.nan)
        lines.append(Line(f"level {height:.3g}", shown[:, 0], shown[:, 1], PALE, width=0.8))
    return lines


def spaced(path: Matrix, among: NDArray[np.intp], count: int) -> list[int]:
    """About ``count`` of the given samples of a path, evenly spaced along its way."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[among], axis=0), axis=1))])
    return sorted({int(among[np.argmin(np.abs(way - at))]) for at in np.linspace(0.0, way[-1], count)})


def main() -> None:
    """Let a stage learn, and draw a trajectory of its last problem."""
    given = arguments(quick=False, seed=0)
    drawn, sentence = figure(slice_of(problem_of(learned(rig_of(given, seed=given.seed, solver="box_active_set")))))
    show(drawn, [sentence], given.out)


if __name__ == "__main__":
    main()
