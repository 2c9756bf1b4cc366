"""The programs of a batch race: mixtures of neighbouring windows of recordings, no two alike.

Every simulated actuator under every drive, identified with a model of d = 18 (n = 5, m = 3) or d = 60 (n = 20, m = 9),
gives a family of four windows. A program is drawn from one family,

    P = Σ θ_k P_k,   q = Σ θ_k q_k,   c = Σ θ_k c_k,   θ uniform over θ ≥ 0, Σ θ_k = 1,   lb ≤ x,

and the family is drawn for each program. Active sets, condition numbers (1e4 to 1e11) and bounds differ from program to
program. A child mixes the programs of its request, which follow from the families and a seed. Only the parent knows
which answers are judged; their optima are proven after the solvers have answered.
"""

from collections.abc import Iterator
from functools import cache

import numpy as np

from bench.messages.progress import Progress
from bench.problems.fresh import proven_mixture
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.problems.simulation import DRIVES, Experiment
from bench.races.batch.worker import Families
from bench.store import Run
from piezo_model import plants

ORDERS = {18: (5, 3), 60: (20, 9)}
"""Orders n and m of the model by d."""
SET = "batch"


class Programs:
    """All ``count`` programs of one size, and the proofs of those whose answers are judged.

    The run stores the families, at most ``limit`` of them, so that a resumed race has the same programs.
    """

    def __init__(self, run: Run, d: int, count: int, seed: int, limit: int | None, progress: Progress) -> None:
        self._forms = [problem.forms["scaled"] for problem in _families(run, d, seed, limit, progress)]
        self.families = Families(
            np.array([[form.qp.P, *(window.P for window in form.windows)] for form in self._forms]),
            np.array([[form.qp.q, *(window.q for window in form.windows)] for form in self._forms]),
            np.array([form.qp.lb for form in self._forms]),
            np.array([form.qp.ub for form in self._forms]),
            (seed, d),
            count,
        )
        self._family, self._shares = self.families.drawn()
        self._rank = np.random.default_rng().permutation(count)  # not reproducible on purpose
        self.proven = cache(lambda b: proven_mixture(self._forms[self._family[b]], self._shares[b], np.ones(1)))
        """A program with its certified optimum; None if it cannot be proven."""

    def judged(self, first: int, last: int, most: int) -> Iterator[tuple[int, CertifiedForm]]:
        """At most ``most`` of the programs ``first`` to ``last`` − 1, each with its certified optimum, without those
        that cannot be proven; overlapping ranges share them, so that few proofs are needed."""
        chosen = sorted(first + int(i) for i in np.argsort(self._rank[first:last])[:most])
        return ((b, form) for b in chosen if (form := self.proven(b)) is not None)


def _families(run: Run, d: int, seed: int, limit: int | None, progress: Progress) -> list[RaceProblem]:
    """A problem with its windows for each actuator and drive, stored in the run."""
    cases = [(plant, drive) for plant in plants.names() for drive in DRIVES][:limit]
    problems = []
    for i, (plant, drive) in enumerate(cases):
        progress(f"{plant} under a {drive}, d = {d}", i, len(cases))
        name = f"{plant}-{drive}-{d}"
        path = run.problem_path(SET, name)
        if not path.is_file():
            Experiment(plant, drive, *ORDERS[d], seed=seed + i).problem(SET, name).save(path)
        problems.append(run.problem(SET, name))
    return problems
