"""A data basis that forgets, over an actuator whose gain drifts: a sequence of problems, each close to the previous
one.

    P_k = Σ_j λ^(k−j) Ξ_j Ξ_jᵀ / W_k,   λ = exp(−Ts/τ),   τ = 2 s

There is one problem every quarter of a second, with the optimum of the previous one as ``warm_start``. A solver that
runs beside a controller gets such problems, and a warm start should help there.
"""

import math
from collections.abc import Iterator, Sequence

from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from bench.problems.simulation import SAMPLE_TIME, Experiment

TIME_CONSTANT_S = 2.0
DRIFT_PER_S = 0.005
BUILD_S = 2.0
"""Time before the first problem, which has no predecessor and is not raced."""
EVERY_S = 0.25
COUNT = 32
UNSEEN_S = 0.5


class Drift(ProblemSet):
    """The Preisach actuator under a random walk, its gain drifting by half a per cent a second."""

    name = "drift"
    description = "snapshots of a forgetting data basis (2 s) every 0.25 s over a drifting actuator, with warm starts"

    def names(self) -> Sequence[str]:
        """Moments of the snapshots."""
        return [f"t{BUILD_S + k * EVERY_S:05.2f}s" for k in range(1, COUNT + 1)]

    def problems(self) -> Iterator[RaceProblem]:
        """Certify a snapshot every quarter of a second."""
        experiment = Experiment(
            "relay_preisach", "random_walk", build_s=BUILD_S, drift_per_s=DRIFT_PER_S, seed=self.seed
        )
        plant, x, y, basis = experiment.measured(
            BUILD_S + COUNT * EVERY_S + UNSEEN_S, math.exp(-SAMPLE_TIME / TIME_CONSTANT_S)
        )
        first, step, unseen_samples = (round(seconds / SAMPLE_TIME) for seconds in (BUILD_S, EVERY_S, UNSEEN_S))
        basis.update(x[:first], y[:first])
        start = basis.problem()
        previous, neighbours = certified(self.name, "start", start).optimal_weights, [start]
        for name, end in zip(self.names(), range(first + step, first + COUNT * step + 1, step), strict=True):
            basis.update(x[end - step : end], y[end - step : end])
            unseen = slice(end, end + unseen_samples)
            validation = Validation(basis.structure, basis.state.copy(), x[unseen], y[unseen], plant.noise_um)
            now = basis.problem()
            problem = certified(self.name, name, now, validation, previous, neighbours[-3:])
            previous = problem.optimal_weights
            neighbours.append(now)
            yield problem
