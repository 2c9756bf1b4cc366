"""Certified problems of a simulated actuator under a drive, and the problem sets that consist of them.

No actuator is in the model class. Each starts at the low end of its major loop, is driven for the building phase and
measured with noise and quantisation; the unseen data for validation follow, under another drive.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from bench.problems.protocol import ProblemSet, RaceProblem, Validation, certified
from piezo_model import DataBasis, ModelStructure, OperatorState, Recording, plants
from piezo_model.identification.error_model import ProgramSolver
from piezo_model.identification.forward import fit_forward, step_problem
from piezo_model.signals import SIGNALS, decaying_triangle
from solvers.arrays import Vector

SAMPLE_TIME = 125e-6
VALIDATION_S = 2.0
CREEP_RATES = (100.0, 10.0, 1.0, 0.1)
FORGOTTEN_S = 2.0
DRIFT_PER_S = 0.005
"""Time constant of the data basis of the set drift, and change of its actuator's gain."""
FIRST_S, EVERY_S, SNAPSHOTS, UNSEEN_S = 2.0, 0.25, 32, 0.5
"""Time before its first problem, which has no predecessor and is not raced; from one to the next, and their number;
and length of the unseen data."""

STEPPED, STEPS = ("relay_preisach", "bouc_wen", "maxwell_slip"), 3
"""Actuators of the set forward, and number of steps on each."""


@dataclass(frozen=True)
class Experiment:
    """One building phase."""

    plant: str
    drive: str
    """Names of a simulated actuator and of a signal."""
    n: int = 5
    m: int = 3
    """Orders of the model."""
    build_s: float = 8.0
    """Length of the building phase in s."""
    reach: float = 1.0
    """Share of the input range that the drive covers, from the low end up."""
    noise: float = 2e-4
    """Standard deviation of the sensor's noise relative to the output range; the quantum is half of it."""
    drift_per_s: float = 0.0
    """Relative change of the actuator's gain per second."""
    proximal: float = 1e-10
    """Proximal term, see ``IdentificationProblem``."""
    seed: int = 0

    def measured(self, duration_s: float, forgetting: float = 1.0) -> tuple[plants.Sensor, Vector, Vector, DataBasis]:
        """Actuator with its sensor, input and output over a duration from rest, and an empty data basis.

        The thresholds cover the full input range and the output range of the building phase.
        """
        actuator = plants.get(self.plant, sample_time=SAMPLE_TIME)
        (low, high), noise_um = actuator.x_range, self.noise * (actuator.y_range[1] - actuator.y_range[0])
        plant = plants.Sensor(
            actuator, noise_um=noise_um, quantum_um=noise_um / 2.0, gain_drift_per_s=self.drift_per_s, seed=self.seed
        )
        options = {} if self.drive == "staircase" else {"seed": self.seed}
        x = SIGNALS[self.drive](
            duration_s=duration_s, sample_time=SAMPLE_TIME, low=low, high=low + self.reach * (high - low), **options
        )
        y, built = plant.run(x), round(self.build_s / SAMPLE_TIME)
        y_range = centred_range(x[:built], y[:built], self.reach)
        structure = ModelStructure.equidistant(self.n, self.m, plant.x_range, y_range, CREEP_RATES, SAMPLE_TIME)
        return plant, x, y, DataBasis(structure, OperatorState.settled_at(structure, low), forgetting)

    def problem(self, set_name: str, name: str) -> RaceProblem:
        """Drive, measure, accumulate and certify."""
        plant, x, y, basis = self.measured(self.build_s)
        programs = []
        for quarter in zip(np.split(x, 4), np.split(y, 4), strict=True):
            basis.update(*quarter)
            programs.append(basis.problem(proximal=self.proximal))
        *neighbours, problem = programs
        unseen = decaying_triangle(duration_s=VALIDATION_S, sample_time=SAMPLE_TIME, low=x.min(), high=x.max())
        validation = Validation(basis.structure, basis.state.copy(), unseen, plant.run(unseen), plant.noise_um)
        return certified(set_name, name, problem, validation, neighbours=neighbours)


def centred_range(x: Vector, y: Vector, reach: float = 1.0) -> tuple[float, float]:
    """Range of y about the centre of its loop, halfway between both branches at the middle of x.

    The paper's model has no constant term, so zero must be the centre of its point-symmetric hysteresis. If the drive
    covers only a share of its range, the range of y is stretched accordingly.
    """
    middle = np.abs(x - 0.5 * (x.min() + x.max())) < 0.02 * np.ptp(x)
    centre = 0.5 * (y[middle].min() + y[middle].max())
    half = float(np.max(np.abs(y - centre)))
    if reach < 1.0:  # the covered part lies at the low end
        low = centre - half
        return low, low + 2.0 * half / reach
    return centre - half, centre + half


class Simulated(ProblemSet):
    """A problem set of experiments."""

    experiments: ClassVar[Mapping[str, Experiment]]
    """The experiment of each problem by name; its seed counts from that of the set."""

    def names(self) -> Sequence[str]:
        """Names of the experiments."""
        return [*self.experiments]

    def problems(self) -> Iterator[RaceProblem]:
        """Drive, measure, accumulate and certify."""
        for name, experiment in self.experiments.items():
            if name in self.selected:
                yield replace(experiment, seed=self.seed + experiment.seed).problem(self.name, name)


class Paper(Simulated):
    """The paper's experiment, n = 5, m = 3, d = 18: every simulated actuator under every drive."""

    name = "paper"
    description = "the paper's orders (n = 5, m = 3), building phase of 8 s at 125 µs, every plant under several drives"
    experiments: ClassVar = {
        f"{plant}-{drive}": Experiment(plant, drive, seed=i)
        for plant in plants.names()
        for i, drive in enumerate(("staircase", "multi_sine", "random_walk"))
    }


class Orders(Simulated):
    """The Preisach actuator under a random walk, identified with models of increasing order, d from 8 to 140."""

    name = "orders"
    description = "models of growing order of the same recording, d from 8 to 140"
    experiments: ClassVar = {
        f"d{2 * n + 2 * m + 2:03d}": Experiment("relay_preisach", "random_walk", n, m)
        for n, m in ((2, 1), (5, 3), (8, 4), (12, 6), (20, 9), (30, 12), (40, 14), (50, 19))
    }


class Noise(Simulated):
    """The dense Prandtl–Ishlinskii actuator under a multi-sine, with increasing noise."""

    name = "noise"
    description = "the same building phase measured with noise from none to 1 % of the range"
    experiments: ClassVar = {
        f"noise-{level:.0e}" if level else "noise-none": Experiment(
            "dense_prandtl_ishlinskii", "multi_sine", noise=level
        )
        for level in (0.0, 1e-5, 1e-4, 1e-3, 1e-2)
    }


class Excitation(Simulated):
    """The Preisach actuator under drives that cover less and less of the input range, so that some thresholds are
    barely reached or not at all, in ever shorter building phases; without and with the proximal term.

    Without the proximal term the condition number is that of P with unit diagonal, from 1e4 to 1e12. A singular problem
    has no unique optimum and is certified by its optimal value; if rounding makes P slightly indefinite, the
    certificate contains the shift. In practice the problems are solved with the proximal term.
    """

    name = "excitation"
    description = "drives that leave thresholds unexcited: condition from 1e4 to 1e12 and singular"
    experiments: ClassVar = {
        f"n{n}-m{m}-reach{reach:g}-{build_s:g}s-{'proximal' if proximal else 'bare'}": Experiment(
            "relay_preisach", "multi_sine", n, m, build_s, reach, proximal=proximal
        )
        for n, m, reach, build_s in (
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
        for proximal in (0.0, 1e-10)
    }


class Drift(ProblemSet):
    """A data basis that forgets, over the Preisach actuator under a random walk, whose gain drifts by half a per cent a
    second: a sequence of problems, each close to the previous one.

        P_k = Σ_j λ^(k−j) Ξ_j Ξ_jᵀ / W_k,   λ = exp(−Ts/τ),   τ = 2 s

    The optimum of the previous problem is ``warm_start``. A solver that runs beside a controller gets such problems,
    and a warm start should help there.
    """

    name = "drift"
    description = "snapshots of a forgetting data basis (2 s) every 0.25 s over a drifting actuator, with warm starts"

    def names(self) -> Sequence[str]:
        """Moments of the snapshots."""
        return [f"t{FIRST_S + k * EVERY_S:05.2f}s" for k in range(1, SNAPSHOTS + 1)]

    def problems(self) -> Iterator[RaceProblem]:
        """Certify a snapshot every quarter of a second."""
        experiment = Experiment(
            "relay_preisach", "random_walk", build_s=FIRST_S, drift_per_s=DRIFT_PER_S, seed=self.seed
        )
        plant, x, y, basis = experiment.measured(
            FIRST_S + SNAPSHOTS * EVERY_S + UNSEEN_S, math.exp(-SAMPLE_TIME / FORGOTTEN_S)
        )
        first, step, unseen_samples = (round(seconds / SAMPLE_TIME) for seconds in (FIRST_S, EVERY_S, UNSEEN_S))
        basis.update(x[:first], y[:first])
        start = basis.problem()
        previous, neighbours = certified(self.name, "start", start).optimal_weights, [start]
        for name, end in zip(self.names(), range(first + step, first + SNAPSHOTS * step + 1, step), strict=True):
            basis.update(x[end - step : end], y[end - step : end])
            unseen = slice(end, end + unseen_samples)
            validation = Validation(basis.structure, basis.state.copy(), x[unseen], y[unseen], plant.noise_um)
            now = basis.problem()
            problem = certified(self.name, name, now, validation, previous, neighbours[-3:])
            previous = problem.optimal_weights
            neighbours.append(now)
            yield problem


class Forward(ProblemSet):
    """Programs of the steps by which ``identify`` minimises the error of the output
    (`piezo_model.identification.forward`), three on each of three actuators.

    They have the box of (6) and begin at its optimum, and the modelled output in place of the measured one among the
    regressors. The first half of the samples is a neighbouring window.
    """

    name = "forward"
    description = "the programs of the Gauss–Newton steps from the optimum of (6) to the smallest error of the output"

    def names(self) -> Sequence[str]:
        """Names of the steps on all actuators."""
        return [f"{actuator}-step-{step}" for actuator in STEPPED for step in range(1, STEPS + 1)]

    def problems(self) -> Iterator[RaceProblem]:
        """Drive, measure, and certify the program of each step, which starts from the weights of the one before."""
        solving = ProgramSolver()
        for name in STEPPED:
            experiment = Experiment(name, "multi_sine", noise=1e-3, seed=self.seed)
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
                yield certified(
                    self.name, f"{name}-step-{step + 1}", all_of_it, validation, fit.weights, neighbours=[half]
                )
                v = fit.v
