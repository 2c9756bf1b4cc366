"""What a poor drive does to the problem: condition numbers from 1e4 to 1e12, singular, and indefinite by rounding.

The drive covers less and less of the input range, so that thresholds are reached by a little or not at all, and the
building phase gets shorter. Without the proximal term the problem shows its own condition, that of P with unit
diagonal; singular ones have no unique optimum and are certified by their optimal value, and where rounding leaves P a
little indefinite the certificate says by how much it was shifted. The same problems with the proximal term are what is
solved in practice.
"""

from collections.abc import Mapping

from bench.problems.simulation import Experiment, Simulated

CASES = (
    (5, 3, 1.0, 8.0),
    (5, 3, 0.9, 8.0),
    (12, 6, 1.0, 8.0),
    (5, 3, 1.0, 0.05),
    (20, 9, 1.0, 8.0),
    (20, 9, 1.0, 0.2),
    (20, 9, 1.0, 0.05),
    (40, 14, 1.0, 0.2),
    (5, 3, 0.7, 8.0),
    (5, 3, 0.4, 8.0),
    (5, 3, 0.2, 2.0),
    (5, 3, 0.2, 0.05),
)
"""(n, m, share of the input range that the drive covers, length of the building phase in s)."""


class Excitation(Simulated):
    """The Preisach actuator under drives that reach less and less, without and with the proximal term."""

    name = "excitation"
    description = "drives that leave thresholds unexcited: condition from 1e4 to 1e12 and singular"

    def experiments(self) -> Mapping[str, Experiment]:
        """Each case as the data give it, then with the proximal term."""
        return {
            f"n{n}-m{m}-reach{reach:g}-{build_s:g}s-{'proximal' if proximal else 'bare'}": Experiment(
                "relay_preisach", "multi_sine", n, m, build_s, reach, proximal=proximal, seed=self.seed
            )
            for n, m, reach, build_s in CASES
            for proximal in (0.0, 1e-10)
        }
