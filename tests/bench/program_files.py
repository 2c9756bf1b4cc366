"""Random programs in the style of the Maros–Mészáros set, written as MAT and as QPS."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from qpsolvers import Problem
from scipy.io import savemat
from scipy.sparse import issparse

from bench.problem_files.program import QP_FIELDS, fields_of
from bench.problems import RaceProblem

INF = 1e20


@dataclass(frozen=True)
class Drawn:
    """minimise ½ xᵀP x + qᵀx + r subject to l ≤ C x ≤ u, lb ≤ x ≤ ub; infinity is 1e20."""

    P: sp.csc_matrix
    q: np.ndarray
    r: float
    C: sp.csc_matrix
    l: np.ndarray  # noqa: E741
    u: np.ndarray
    lb: np.ndarray
    ub: np.ndarray


def _dyadic(values: np.ndarray) -> np.ndarray:
    """Sixteenths, so that sums and differences in a file are exact."""
    return np.round(16.0 * values) / 16.0


def draw(seed: int = 0, d: int = 12) -> Drawn:
    """Equalities, ranges, one-sided rows, free and fixed variables, a singular sparse P; feasible and bounded."""
    rng = np.random.default_rng(seed)

    def sparse(rows: int, share: float) -> np.ndarray:
        return _dyadic(rng.normal(size=(rows, d))) * (rng.random((rows, d)) < share)

    root = sparse(d // 2, 0.3)
    root[0, 0] = 1.0
    C = sparse(9, 0.4)
    C[np.arange(9), np.arange(9)] = 1.5
    x = _dyadic(rng.normal(size=d))
    x[7] = -1.0 - abs(x[7])
    value = C @ x
    l, u = value - 0.5, value + 0.25  # noqa: E741
    l[:3] = u[:3] = value[:3]
    l[5:7], u[7:9] = -INF, INF
    lb, ub = np.minimum(x, 0.0), x + 1.0
    lb[:4], ub[:4] = -INF, INF  # free, but for P below
    ub[4:6] = INF
    lb[6] = ub[6] = x[6]
    lb[7], ub[7] = -INF, x[7] + 0.5
    P = root.T @ root + np.diag(np.r_[np.full(4, 2.0), np.zeros(d - 4)])
    q = np.r_[rng.normal(size=4), np.abs(rng.normal(size=d - 4))]
    q[7] = -1.0
    return Drawn(sp.csc_matrix(P), _dyadic(q), 3.25, sp.csc_matrix(C), l, u, lb, ub)


def write_mat(path: Path, p: Drawn) -> Path:
    """Write the usual conversion: the bounds are the last rows of A, and vectors are columns."""
    d = p.q.size
    A = sp.vstack([p.C, sp.identity(d)], format="csc")
    savemat(
        path,
        {
            "P": p.P,
            "q": p.q[:, None],
            "r": p.r,
            "A": A,
            "l": np.r_[p.l, p.lb][:, None],
            "u": np.r_[p.u, p.ub][:, None],
            "n": d,
            "m": A.shape[0],
        },
    )
    return path


def write_qps(path: Path, p: Drawn) -> Path:
    """Write fields separated by blanks, one triangle of P, and exact numbers."""
    d, lines = p.q.size, ["* drawn", f"NAME          {path.stem}", "ROWS", " N  COST"]
    kinds = ["E" if low == high else "L" if high < INF else "G" for low, high in zip(p.l, p.u, strict=True)]
    lines += [f" {kind}  R{i}" for i, kind in enumerate(kinds)] + ["COLUMNS"]
    for j in range(d):
        entries = [("COST", p.q[j]), *((f"R{i}", p.C[i, j]) for i in range(len(kinds)) if p.C[i, j])]
        for two in (entries[k : k + 2] for k in range(0, len(entries), 2)):
            lines.append(
                f"    X{j}  "
                + "  ".join(f"{name} {value!r}" for name, value in ((name, float(value)) for name, value in two))
            )
    lines += ["RHS", f"    RHS  COST  {-p.r!r}"]
    lines += [f"    RHS  R{i}  {float(p.l[i] if kind == 'G' else p.u[i])!r}" for i, kind in enumerate(kinds)]
    lines += ["RANGES"]
    lines += [
        f"    RNG  R{i}  {float(p.u[i] - p.l[i])!r}" for i, kind in enumerate(kinds) if kind == "L" and p.l[i] > -INF
    ]
    lines += ["BOUNDS"]
    for j, (low, high) in enumerate(zip(p.lb.tolist(), p.ub.tolist(), strict=True)):
        if low == high:
            lines.append(f" FX BND  X{j}  {low!r}")
        elif (low, high) == (-INF, INF):
            lines.append(f" FR BND  X{j}")
        else:
            lines.append(f" MI BND  X{j}" if low == -INF else f" LO BND  X{j}  {low!r}")
            lines += [f" UP BND  X{j}  {high!r}"] if high < INF else []
    lines += ["QUADOBJ"]
    lines += [f"    X{i}  X{j}  {float(p.P[i, j])!r}" for i in range(d) for j in range(i + 1) if p.P[i, j]]
    path.write_text("\n".join([*lines, "ENDATA", ""]))
    return path


def dense(matrix: Any) -> np.ndarray:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def same(a: Problem, b: Problem) -> bool:
    pairs = [(getattr(a, name), getattr(b, name)) for name in QP_FIELDS]
    return all((x is None and y is None) or np.array_equal(dense(x), dense(y)) for x, y in pairs)


def same_problem(a: RaceProblem, b: RaceProblem) -> bool:
    """Whether two problems, their proofs and unseen data are exactly equal."""

    def parts(problem: RaceProblem) -> list[object]:
        found: list[object] = [problem.name, problem.d, problem.sense, [*problem.forms]]
        for form in problem.forms.values():
            found += [*fields_of(form.qp).values(), form.to_weights, *form.starts, *form.starts.values()]
            found += [form.certificate, form.c, form.cost_unit]
        v = problem.validation
        return found + ([] if v is None else [v.state.play, v.state.creep, v.x, v.y, v.noise_um])

    def plain(value: object) -> object:
        found = dense(value) if issparse(value) else value
        return (issparse(value), found.tobytes()) if isinstance(found, np.ndarray) else found

    return [*map(plain, parts(a))] == [*map(plain, parts(b))]
