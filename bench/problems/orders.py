"""Problems of an increasing number of unknowns, d = 2n + 2m + 2 from 8 to 140."""

from collections.abc import Mapping

from bench.problems.simulation import Experiment, Simulated

ORDERS = ((2, 1), (5, 3), (8, 4), (12, 6), (20, 9), (30, 12), (40, 14), (50, 19))
"""(n, m), for d = 8, 18, 26, 38, 60, 86, 110, 140."""


class Orders(Simulated):
    """The Preisach actuator under a random walk, identified with models of increasing order."""

    name = "orders"
    description = "models of growing order of the same recording, d from 8 to 140"

    def experiments(self) -> Mapping[str, Experiment]:
        """One experiment per order, smallest first."""
        return {
            f"d{2 * n + 2 * m + 2:03d}": Experiment("relay_preisach", "random_walk", n, m, seed=self.seed)
            for n, m in ORDERS
        }
