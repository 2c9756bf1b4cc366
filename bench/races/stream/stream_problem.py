"""The problem of the stream race: an actuator whose gain drifts, and a data basis that forgets, sample by sample.

The building phase gives the start, P₀, q₀ and c₀ in slope coordinates, scaled to unit diagonal at that time. After it
the row (ξ, x) of every sample is

    ξ(k) = (T D)ᵀ Ξ(k),   x(k) the input,      P(k) = λ P(k−1) + (1 − λ) ξ ξᵀ  and so on, see `solvers.forgetting`,

with T D the map from the scaled slopes to the weights of Ξ in normalised units, fixed at the start, and λ = e^(−Ts/τ).
The problem of sample k is the box QP of P(k), q(k). Its optimum is proven at a few hundred instants, spread evenly; at
all other samples the answer of box_active_set is the reference. The problem is a function of the race's settings, to
the last bit, and is not stored.

The cost of late answers is the gap between the answer in use at each sample and the optimum of that sample. With x̂ the
answer x in use, clipped to the bounds, x* the optimum in doubles and g = P x* + q, it is the larger of violation and
relative cost gap, as `bench.races.metrics` defines them,

    ‖x − x̂‖∞ / ‖x*‖∞,   (½ (x̂ − x*)ᵀ P (x̂ − x*) + gᵀ(x̂ − x*)) / (V(x*) + c),

which avoids the cancellation in V(x̂) − V*. At the proven instants the gap is also computed in exact arithmetic; the
difference of the two is the error of the doubles.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from qpsolvers import Problem

import solvers
from bench.problems.protocol import CertifiedForm
from bench.problems.simulation import SAMPLE_TIME, Experiment
from bench.races.metrics import relative_gap
from piezo_model.regressors import Regressors
from solvers.arrays import Index, Matrix, Vector
from solvers.certificate import certify
from solvers.forgetting import absorb


@dataclass(frozen=True, eq=False)
class StreamProblem:
    """A stream of rows and its optima."""

    name: str
    start: Problem
    """The program before the first row."""
    c: float
    """Its constant."""
    answer: Vector
    """Its certified optimum, in use before the first answer. Shape (d,)."""
    rows: Matrix
    """(ξ, x) of each sample. Shape (N, d + 1)."""
    forgetting: float
    """λ."""
    best: Matrix
    """The optimum of each sample in doubles. Shape (N, d)."""
    instants: Mapping[int, CertifiedForm]
    """Programs with certified optima, by sample."""

    @property
    def d(self) -> int:
        """Number of variables."""
        return int(self.answer.size)

    def gaps(self, answers: Matrix, used: Index) -> Vector:
        """Cost gap or violation of ``answers[used[k]]`` at each sample k, shape (len(used),); −1 is the start's."""
        P, q, c = self.start.P.copy(), self.start.q.copy(), np.array([self.c])
        given = np.vstack([answers, self.answer])[used]  # −1 is the last
        in_use = given.clip(self.start.lb, self.start.ub)
        gaps = np.abs(given - in_use).max(axis=1)  # the violations
        for k, (best, step) in enumerate(zip(self.best, in_use - self.best[: used.size], strict=False)):
            absorb(P, q, c, self.rows, k, k + 1, self.forgetting)
            Px = P @ best
            above = ((0.5 * (P @ step) + Px + q) @ step) / (c[0] + (0.5 * Px + q) @ best)
            gaps[k] = max(above, gaps[k] / (np.abs(best).max() or 1.0))
        return gaps

    def exact_gaps(self, answers: Matrix, used: Index) -> tuple[Index, Vector]:
        """The proven instants among the samples, and the same gaps there in exact arithmetic."""
        in_use = np.vstack([answers, self.answer])
        forms = {sample: form for sample, form in self.instants.items() if sample < used.size}
        gaps = [max(relative_gap(form, in_use[used[k]])) for k, form in forms.items()]
        return np.array(list(forms), dtype=np.int64), np.array(gaps)


def make(experiment: Experiment, samples: int, time_constant_s: float, certified: int) -> StreamProblem:
    """Drive and measure the actuator, and turn the ``samples`` after the building phase into rows.

    The data basis of the building phase and the stream forget with the same time constant. At most ``certified``
    optima are proven, at most every tenth and the last.
    """
    forgetting = float(np.exp(-SAMPLE_TIME / time_constant_s))
    _, x, y, basis = experiment.measured(experiment.build_s + samples * SAMPLE_TIME, forgetting)
    structure, built = basis.structure, x.size - samples
    basis.update(x[:built], y[:built])
    form = basis.problem(proximal=experiment.proximal).form("slope", "scaled")
    start = form.qp
    later = structure.unit_input(x[built:]), structure.unit_output(y[built:])
    rows = Regressors(structure, basis.state).rows(*later)
    rows = np.ascontiguousarray(np.column_stack([rows[:, 1:] @ form.to_weights, rows[:, 0]]))
    reference = solvers.get("box_active_set", "kernel")
    reference.setup(start)
    answer = np.array(certify(start, reference.solve(np.zeros(structure.d))).x)
    P, q, c, best, instants = start.P.copy(), start.q.copy(), np.array([form.c]), np.empty((samples, answer.size)), {}
    proven = set(np.linspace(samples - 1, 0, min(certified, 1 + samples // 10)).round().astype(int).tolist())
    for k in range(samples):
        absorb(P, q, c, rows, k, k + 1, forgetting)
        reference.update(P, q)
        best[k] = reference.solve(best[k - 1] if k else answer)
        if k in proven:
            qp = Problem(P.copy(), q.copy(), lb=start.lb, ub=start.ub)
            instants[k] = CertifiedForm(qp, float(c[0]), form.to_weights, certify(qp, best[k]))
    name = f"{experiment.plant}-{experiment.drive}"
    return StreamProblem(name, start, form.c, answer, rows, forgetting, best, instants)
