"""Learning on actuators outside the model class, compared with the best model of the class in hindsight.

Each actuator follows the staircase with sensor noise of 2e-4 of its range. The model in hindsight has the same orders
and is identified from the very cycle on which it is evaluated (`hindsight`).
"""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd
from hindsight import ROUNDS, SOLVER, floor
from outputs import arguments, show
from two_axis_stage import CREEP_RATES, LEVELS, Setup, setup_of

from bench.report.report import GREY, INK, PALETTE, Axis, Figure, Mark, Plot
from piezo_model import ModelStructure, SelfLearningCompensator, plants
from piezo_model.learning.settings import Mode
from piezo_model.signals import staircase
from solvers.arrays import Vector

NOISE = 2e-4
"""Standard deviation of the sensor's noise, as a share of the range."""
MARGIN = 0.08
"""Margin on either side of the staircase, as a share of the range."""


@dataclass(frozen=True)
class Case:
    """One learner: actuator, numbers of plays and dead zones, mode."""

    plant: str
    n: int
    m: int
    mode: Mode

    def __str__(self) -> str:
        return f"{self.plant}, {self.mode}, n = {self.n}, m = {self.m}"

    def row(self, setup: Setup) -> dict[str, Any]:
        """Errors in percent of the actuator's range: of each cycle, in hindsight, and of straight lines."""
        sensor = sensor_of(self.plant, setup)
        structure = ModelStructure.equidistant(
            self.n, self.m, sensor.x_range, sensor.y_range, CREEP_RATES, setup.sample_time
        )
        learner = SelfLearningCompensator(
            structure,
            setup.reset_s,
            setup.build_s,
            setup.learn_s,
            SOLVER,
            sensor.x_range,
            self.mode,
            x_start=structure.x_range[0],
            solve_delay_samples=1,
        )
        y_ref, errors = steps(sensor, setup), []
        for cycle in np.split(y_ref, setup.cycles):
            state, before = learner.compensator.state.copy(), deepcopy(sensor)
            x, y = learner.run(cycle, sensor.run)
            errors.append(rms_percent(y - cycle, sensor))
        hindsight = floor(learner.model, state, before, x, y, cycle) * 100.0 / float(np.ptp(sensor.y_range))
        straight, best = straight_lines(sensor_of(self.plant, setup), y_ref[-setup.cycle :])
        return {
            **asdict(self),
            "straight_percent": straight,
            "best_straight_percent": best,
            "hindsight_percent": hindsight,
            **{f"cycle_{i}_percent": error for i, error in enumerate(errors, 1)},
        }


LEARNERS: tuple[tuple[int, int, Mode], ...] = ((5, 3, "cyclic"), (5, 3, "continuous"), (20, 7, "cyclic"))
"""Orders and mode; the figure shows hindsight for the first."""
CASES = tuple(Case(plant, *learner) for plant in plants.names() for learner in LEARNERS)


def sensor_of(plant: str, setup: Setup) -> plants.Sensor:
    """The actuator with a noisy sensor, at the low end of its drive."""
    actuator = plants.get(plant, sample_time=setup.sample_time)
    return plants.Sensor(actuator, noise_um=NOISE * float(np.ptp(actuator.y_range)), seed=setup.seed)


def steps(sensor: plants.Sensor, setup: Setup) -> Vector:
    """The staircase for all cycles, µm."""
    low, high = sensor.y_range
    margin = MARGIN * (high - low)
    return staircase(
        duration_s=setup.cycles * setup.cycle * setup.sample_time,
        sample_time=setup.sample_time,
        low=low + margin,
        high=high - margin,
        levels=LEVELS,
        hold_s=setup.hold_s,
    )


def rms_percent(error: Vector, sensor: plants.Sensor) -> float:
    """RMS of an error in µm, percent of the actuator's range."""
    return float(np.sqrt(np.mean(error**2)) * 100.0 / np.ptp(sensor.y_range))


def straight_lines(sensor: plants.Sensor, y_ref: Vector) -> tuple[float, float]:
    """Errors of the line through the corners of the ranges, and of the best x = a + b y_ref, by Gauss-Newton."""
    (low, high), (y_low, y_high) = sensor.x_range, sensor.y_range
    slope = (high - low) / (y_high - y_low)
    offset = low - slope * y_low
    errors = []
    for _ in range(ROUNDS):
        sensor.reset()
        y = sensor.run(np.clip(offset + slope * y_ref, low, high))
        errors.append(rms_percent(y - y_ref, sensor))
        turn, shift = np.polyfit(y_ref, y_ref - y, 1)
        offset, slope = offset + slope * shift, slope * (1.0 + turn)
    return errors[0], min(errors)


def figure(table: pd.DataFrame) -> Figure:
    """Draw the rows of all cases."""
    lines, cycles = [], cycles_of(table)
    for plant, rows in table.groupby("plant", sort=False):
        first = rows.iloc[0]
        levels = {
            "best straight line": first.best_straight_percent,
            "with hindsight": first.hindsight_percent,
            "noise of the sensor": 100.0 * NOISE,
        }
        errors = {
            f"{mode}, n = {n}, m = {m}": found
            for found, (n, m, mode) in zip(rows[cycles].to_numpy(float), LEARNERS, strict=True)
        }
        lines += [
            {"plant": plant, "name": name, "cycle": cycle, "percent": percent}
            for name, values in {
                **{name: np.full(len(cycles), level) for name, level in levels.items()},
                **errors,
            }.items()
            for cycle, percent in enumerate(values, 1)
        ]
    cycle = Axis("cycle", "cycle", values=range(1, len(cycles) + 1), format="d")
    colours = dict(zip([*levels, *errors], (PALETTE[1], PALETTE[2], GREY, PALETTE[0], PALETTE[5], INK), strict=True))
    plots = [
        Plot(
            cycle,
            Axis("percent", f"{str(plant).replace('_', ' ')}: RMS error, %", log=True),
            (Mark("line", "name"), Mark("point", "name")),
            where={"plant": [plant]},
            colours=colours,
            height=200,
        )
        for plant in table.plant.unique()
    ]
    return Figure(
        "actuators",
        "Actuators that are not in the model class",
        f"RMS error of one actuator in each cycle, with noise of {100.0 * NOISE:g} % of range on its sensor. "
        "Hindsight is the "
        "best model of the same orders, n = 5 and m = 3, identified from the last cycle itself.",
        pd.DataFrame(lines),
        plots,
    )


def sentences(table: pd.DataFrame) -> Iterator[str]:
    """Compare every learner with hindsight, the straight line and the noise."""
    last = table[cycles_of(table)[-1]]
    for case, error, hindsight, line in zip(
        CASES, last, table.hindsight_percent, table.best_straight_percent, strict=True
    ):
        yield (
            f"{case}: {error:.3f} % in the last cycle, {error / hindsight:.2f} times what hindsight gives, "
            f"{line / error:.0f} times "
            f"less than the best straight line ({line:.2f} %), {error / (100.0 * NOISE):.2f} times the noise."
        )


def cycles_of(table: pd.DataFrame) -> list[str]:
    """Names of the columns with the error of a cycle."""
    return [str(name) for name in table if str(name).startswith("cycle_")]


def main() -> None:
    """Let every learner learn on every actuator."""
    given = arguments(quick=False, seed=0)
    table = pd.DataFrame([case.row(setup_of(given)) for case in CASES])
    show(figure(table), sentences(table), given.out)


if __name__ == "__main__":
    main()
