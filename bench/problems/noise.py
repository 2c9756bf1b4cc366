"""Problems of increasing sensor noise and quantisation, from none to one percent of the range."""

from collections.abc import Mapping

from bench.problems.simulation import Experiment, Simulated

LEVELS = (0.0, 1e-5, 1e-4, 1e-3, 1e-2)


class Noise(Simulated):
    """The dense Prandtl–Ishlinskii actuator under a multi-sine, with increasing noise."""

    name = "noise"
    description = "the same building phase measured with noise from none to 1 % of the range"

    def experiments(self) -> Mapping[str, Experiment]:
        """One experiment per noise level."""
        return {
            f"noise-{level:.0e}" if level else "noise-none": Experiment(
                "dense_prandtl_ishlinskii", "multi_sine", noise=level, seed=self.seed
            )
            for level in LEVELS
        }
