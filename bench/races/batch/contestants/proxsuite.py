"""ProxQP's own batch, solved by its threads; see ``solvers/direct/proxsuite.py``.

Bounds are rows: a batch supports no other, and they were faster than the library's own box. Each batch makes new
objects, since reusing those of the previous one took about as long. With looser tolerances some answers miss 1e-9.
"""

import numpy as np
from proxsuite import proxqp

from bench.races.batch.contestant import Contestant
from solvers import backend as known
from solvers.arrays import Matrix

SETTINGS = {
    "eps_abs": 1e-12,
    "eps_rel": 0.0,
    "check_duality_gap": True,
    "eps_duality_gap_abs": 1e-12,
    "eps_duality_gap_rel": 0.0,
    "max_iter": 1000,
}


class Proxsuite(Contestant):
    """``dense.BatchQP`` and ``solve_in_parallel``."""

    algorithm, licence, distribution = known.PROXQP.algorithm, known.PROXQP.licence, known.PROXQP.distribution

    def solve(self, P: Matrix, q: Matrix, lb: Matrix, ub: Matrix) -> Matrix:  # noqa: D102
        batch, rows = proxqp.dense.BatchQP(), np.eye(self.d)
        for b in range(len(q)):
            qp = batch.init_qp_in_place(self.d, 0, self.d)
            for name, value in SETTINGS.items():
                setattr(qp.settings, name, value)
            qp.init(P[b], q[b], None, None, rows, lb[b], ub[b])
        proxqp.dense.solve_in_parallel(batch, self.threads)
        return np.array([batch.get(b).results.x for b in range(len(q))])
