"""Problems of poor excitation: condition numbers from 1e4 to 1e12, singular, and indefinite by rounding.

The drive covers less and less of the input range, so that some thresholds are barely reached or not at all, and the
building phase gets shorter. Without the proximal term the condition number is that of P with unit diagonal. A singular
problem has no unique optimum and is certified by its optimal value; if rounding makes P slightly indefinite, the
certificate contains the shift. In practice the problems are solved with the proximal term.
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
    """The Preisach actuator under drives of decreasing range, without and with the proximal term."""

    name = "excitation"
    description = "drives that leave thresholds unexcited: condition from 1e4 to 1e12 and singular"

    def experiments(self) -> Mapping[str, Experiment]:
        """Each case without and with the proximal term."""
        return {
            f"n{n}-m{m}-reach{reach:g}-{build_s:g}s-{'proximal' if proximal else 'bare'}": Experiment(
                "relay_preisach", "multi_sine", n, m, build_s, reach, proximal=proximal, seed=self.seed
            )
            for n, m, reach, build_s in CASES
            for proximal in (0.0, 1e-10)
        }
