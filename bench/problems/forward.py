"""Programs of the steps by which ``identify`` minimises the error of the output (`piezo_model.identification.forward`).

They have the box of (6) and begin at its optimum, and the modelled output in place of the measured one among the
regressors.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from bench.problems.simulation import SAMPLE_TIME, VALIDATION_S, Experiment
from piezo_model import Recording
from piezo_model.identification.error_model import Solving
from piezo_model.identification.forward import fit_forward, step_problem
from piezo_model.signals import decaying_triangle

ACTUATORS = ("relay_preisach", "bouc_wen", "maxwell_slip")
NOISE = 1e-3
STEPS = 3


class Forward(ProblemSet):
    """Three steps on each of three actuators, with the first half of the samples as a neighbouring window."""

    name = "forward"
    description = "the programs of the Gauss–Newton steps from the optimum of (6) to the smallest error of the output"

    def names(self) -> Sequence[str]:
        """Names of the steps on all actuators."""
        return [f"{actuator}-step-{step}" for actuator in ACTUATORS for step in range(1, STEPS + 1)]

    def problems(self) -> Iterator[RaceProblem]:
        """Drive, measure, and certify the program of each step, which starts from the weights of the one before."""
        solving = Solving()
        for name in ACTUATORS:
            experiment = Experiment(name, "multi_sine", noise=NOISE, seed=self.seed)
            plant, x, y, basis = experiment.measured(experiment.build_s)
            s, states = basis.structure, [basis.state.copy()]
            basis.update(x, y)
            unseen = decaying_triangle(duration_s=VALIDATION_S, sample_time=SAMPLE_TIME, low=x.min(), high=x.max())
            validation = Validation(s, basis.state.copy(), unseen, plant.run(unseen), plant.noise_um)
            first, recording = basis.problem(), Recording.from_arrays(x, y, SAMPLE_TIME)
            whole, v = np.ones(x.size, dtype=bool), s.inverse_slope_map @ solving.optimum(first)
            for step in range(STEPS):
                fit = fit_forward(recording, whole, s, states, v, solving, steps=min(step, 1))
                half, all_of_it = (
                    step_problem(recording, counted, fit, first) for counted in (np.arange(x.size) < x.size // 2, whole)
                )
                program = f"{name}-step-{step + 1}"
                yield certified(self.name, program, all_of_it, validation, fit.weights, neighbours=[half])
                v = fit.v
