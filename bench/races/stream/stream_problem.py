"""The drift scenario sample by sample: an actuator whose gain drifts, and a data basis that forgets.

The building phase gives the start, P₀, q₀ and c₀ in slope coordinates, scaled to unit diagonal *then*. After it the row
(ξ, x) of every sample is

    ξ(k) = (T D)ᵀ Ξ(k),   x(k) the input,      P(k) = λ P(k−1) + (1 − λ) ξ ξᵀ  and so on, see `solvers.forgetting`,

with T D the map from the scaled slopes to the weights of Ξ in unit amplitudes, fixed at the start, and λ = e^(−Ts/τ).
The problem of sample k is the box QP of P(k), q(k). At a few hundred instants, spread evenly, its optimum is proven; at
all others a solver of the caller's choice is the reference. All of it follows from the settings of a race to the last
bit, so that none is kept.

What late answers cost is told by the answer in use at each sample against the optimum of that sample. With x the answer
in use, clipped to the bounds, x* the optimum in doubles and g = P x* + q, the relative cost gap is

    (½ (x − x*)ᵀ P (x − x*) + gᵀ(x − x*)) / (V(x*) + c),

which is V(x) − V* without the cancellation of two nearly equal numbers. At the proven instants of the stream it is
computed in exact arithmetic instead, and the difference of the two there shows how far the doubles can be trusted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from qpsolvers import Problem

import solvers
from bench.problems.simulation import SAMPLE_TIME, Experiment
from piezo_model.regressors import regressor_rows
from solvers.arrays import Index, Matrix, Vector
from solvers.certificate import Certificate, certify, exact_cost_gap
from solvers.forgetting import absorb


@dataclass(frozen=True)
class Instant:
    """The problem of one sample with its proven optimum."""

    sample: int
    qp: Problem
    c: float
    certificate: Certificate


@dataclass(frozen=True, eq=False)
class StreamProblem:
    """A stream of rows and what is known of its optima."""

    name: str
    start: Problem
    """The program before the first row."""
    c: float
    """Its constant."""
    answer: Vector
    """Its proven optimum, in use before the first answer. Shape (d,)."""
    rows: Matrix
    """(ξ, x) of each sample. Shape (N, d + 1)."""
    forgetting: float
    """λ."""
    best: Matrix
    """The optimum of each sample in doubles. Shape (N, d)."""
    instants: tuple[Instant, ...]

    @property
    def d(self) -> int:
        """Number of variables."""
        return int(self.answer.size)

    def gaps(self, answers: Matrix, used: Index) -> Vector:
        """Relative cost gap of ``answers[used[k]]`` at each sample k, shape (len(used),); −1 is the start's answer."""
        P, q, c = self.start.P.copy(), self.start.q.copy(), np.array([self.c])
        in_use = np.vstack([answers, self.answer]).clip(self.start.lb, self.start.ub)[used]  # −1 is the last
        gaps = np.empty(used.size)
        for k, (best, step) in enumerate(zip(self.best, in_use - self.best[: used.size], strict=False)):
            absorb(P, q, c, self.rows, k, k + 1, self.forgetting)
            Px = P @ best
            gaps[k] = ((0.5 * (P @ step) + Px + q) @ step) / (c[0] + (0.5 * Px + q) @ best)
        return gaps

    def exact_gaps(self, answers: Matrix, used: Index) -> tuple[Index, Vector]:
        """The proven instants among the samples, and the gap there in exact arithmetic."""
        in_use = np.vstack([answers, self.answer])
        among = [instant for instant in self.instants if instant.sample < used.size]
        gaps = [exact_cost_gap(i.qp, i.certificate, in_use[used[i.sample]], i.c).relative for i in among]
        return np.array([instant.sample for instant in among], dtype=np.int64), np.array(gaps)


def make(experiment: Experiment, samples: int, time_constant_s: float, certified: int) -> StreamProblem:
    """Drive, measure and turn the ``samples`` that follow the building phase into rows.

    Both forget with the time constant; so many instants get a proof as are to be ``certified``, at most every tenth
    sample and the last.
    """
    forgetting = float(np.exp(-SAMPLE_TIME / time_constant_s))
    _, x, y, basis = experiment.measured(experiment.build_s + samples * SAMPLE_TIME, forgetting)
    structure, built = basis.structure, x.size - samples
    basis.update(x[:built], y[:built])
    form = basis.problem(proximal=experiment.proximal).form("slope", "scaled")
    rows = regressor_rows(structure, basis.state.copy(), x[built:], y[built:])
    rows = np.ascontiguousarray(np.column_stack([rows[:, 1:] @ form.to_weights, rows[:, 0]]))
    answer = np.array(certify(form.qp, references(form.qp, rows[:0], forgetting, np.zeros(structure.d))[0]).x)
    wanted = np.unique(np.linspace(samples - 1, 0, min(certified, 1 + samples // 10)).round().astype(int)).tolist()
    best = references(form.qp, rows, forgetting, answer)[1:]
    return StreamProblem(
        f"{experiment.plant}-{experiment.drive}",
        form.qp,
        form.c,
        answer,
        rows,
        forgetting,
        best,
        _proven(form.qp, form.c, rows, forgetting, wanted, best),
    )


def references(start: Problem, rows: Matrix, forgetting: float, x: Vector) -> Matrix:
    """Optima in doubles: of the start, warm from x, and after each row, shape (N + 1, d)."""
    reference = solvers.get("box_active_set", "kernel")
    reference.setup(start)
    first = reference.solve(x).copy()
    return np.vstack([first, reference.time_rows(rows, forgetting)[0]])


def _proven(
    start: Problem,
    c: float,
    rows: Matrix,
    forgetting: float,
    wanted: Sequence[int],
    found: Matrix,
) -> tuple[Instant, ...]:
    """The problems of some samples with their proofs, which begin from the answers found."""
    P, q, constant, done, instants = start.P.copy(), start.q.copy(), np.array([c]), 0, []
    for sample in wanted:
        absorb(P, q, constant, rows, done, sample + 1, forgetting)
        done = sample + 1
        qp = Problem(P.copy(), q.copy(), lb=start.lb, ub=start.ub)
        instants.append(Instant(sample, qp, float(constant[0]), certify(qp, found[sample])))
    return tuple(instants)
