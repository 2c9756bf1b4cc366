"""Random situations for a learner: an actuator, its sensor, a reference and a structure.

A seed gives the same situation on any machine, so that a bad case can be identified by its number. Situations are
independent of the learning method; results for seeds that were used in tuning do not apply to other seeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from disturbed_sensor import DisturbedSensor
from references import changing_amplitude, from_samples, raster_scan, set_point_steps

from piezo_model import plants
from piezo_model.signals import decaying_triangle, multi_sine, random_walk, smoothed, staircase
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

CREEP_RATES = (100.0, 10.0, 1.0, 0.1)
CYCLE_S = 10.0
"""Period of the repeated references in s, about one cycle of learning."""
STEP_S = 0.02


def _repeated(one: Callable[..., Vector]) -> Callable[..., Vector]:
    """The periodic continuation of the first ``CYCLE_S`` of a signal."""

    def signal(random: np.random.Generator, *, duration_s: float, sample_time: float, **limits: float) -> Vector:
        period = one(random, duration_s=CYCLE_S, sample_time=sample_time, **limits)
        return np.resize(period, round(duration_s / sample_time))

    return signal


def _seed(random: np.random.Generator) -> int:
    return int(random.integers(2**31))


def _steps(random: np.random.Generator, **options: float) -> Vector:
    steps = staircase(**options, levels=int(random.integers(4, 14)), hold_s=random.uniform(0.1, 0.4))  # type: ignore[arg-type]
    return smoothed(steps, STEP_S, options["sample_time"])


def _odd_samples(random: np.random.Generator, **options: float) -> Vector:
    """Random values, each held for a random time."""
    values = np.repeat(random.uniform(size=60), random.integers(1, 40, 60))
    return smoothed(from_samples(values, **options, period_s=CYCLE_S), STEP_S, options["sample_time"])


REFERENCES: dict[str, Callable[..., Vector]] = {
    "staircase": _steps,
    "multi_sine": _repeated(
        lambda random, **options: multi_sine(
            **options, tones=int(random.integers(2, 15)), highest_Hz=random.uniform(2.0, 20.0), seed=_seed(random)
        )
    ),
    "raster": _repeated(
        lambda random, **options: raster_scan(
            **options, line_rate_Hz=random.uniform(1.0, 10.0), fast_share=random.uniform(0.3, 0.9)
        )
    ),
    "decaying_triangle": _repeated(
        lambda random, **options: decaying_triangle(
            **options, cycles=float(random.integers(4, 20)), final_share=random.uniform(0.05, 0.6)
        )
    ),
    "samples": _odd_samples,
    "set_points": lambda random, **options: set_point_steps(
        **options, seed=_seed(random), mean_hold_s=random.uniform(0.1, 0.6)
    ),
    "random_walk": lambda random, **options: random_walk(
        **options,
        seed=_seed(random),
        bandwidth_Hz=random.uniform(3.0, 20.0),
        spread_per_root_s=random.uniform(0.5, 3.0),
    ),
    "changing_amplitude": lambda random, **options: changing_amplitude(
        **options, seed=_seed(random), frequency_Hz=random.uniform(0.3, 5.0)
    ),
}
"""References by name: functions of a random generator, duration, sampling period and limits."""


def _bouc_wen(random: np.random.Generator) -> dict[str, float]:
    beta = random.uniform(0.8, 2.5)
    return {
        "loading_slope": random.uniform(0.15, 0.35),
        "beta": beta,
        "gamma": beta * random.uniform(0.0, 1.0),
        "exponent": random.uniform(1.0, 1.8),
    }


INDIVIDUALS: dict[str, Callable[[np.random.Generator], dict[str, float]]] = {
    "bouc_wen": _bouc_wen,
    "dense_prandtl_ishlinskii": lambda random: {
        "thresholds": int(random.integers(20, 60)),
        "reversible_share": random.uniform(0.55, 0.85),
        "threshold_scale": random.uniform(0.15, 0.8),
        "saturation": random.uniform(0.0, 0.15),
        "asymmetry": random.uniform(-0.1, 0.1),
    },
    "duhem": lambda random: {
        "alpha": random.uniform(1.0, 6.0),
        "slope_after_turn": random.uniform(0.6, 0.92),
        "saturation": random.uniform(0.0, 0.15),
        "asymmetry": random.uniform(-0.1, 0.1),
    },
    "maxwell_slip": lambda random: {
        "sliders": int(random.integers(3, 30)),
        "slip_share": random.uniform(0.1, 0.55),
        "reach": random.uniform(0.4, 1.8),
        "saturation": random.uniform(0.0, 0.15),
        "asymmetry": random.uniform(-0.1, 0.1),
    },
    "relay_preisach": lambda random: {
        "reversible_share": random.uniform(0.55, 0.85),
        "half_width_scale": random.uniform(0.2, 0.8),
        "hill_centre": random.uniform(-0.2, 0.3),
        "hill_centre_slope": random.uniform(-0.2, 0.6),
        "hill_breadth": random.uniform(0.9, 1.6),
        "hill_breadth_slope": random.uniform(0.0, 0.6),
    },
}
"""Options of an individual actuator of each kind: functions of a random generator."""


@dataclass(frozen=True)
class Situation:
    """An actuator with its sensor, its assumed ranges and a reference.

    Examples
    --------
    >>> situation = Situation.draw(7, duration_s=2.0, sample_time=1e-3)
    >>> y = situation.sensor().run(np.full(10, situation.x_limits[0]))
    >>> situation.y_ref.size, y.size
    (2000, 10)
    """

    seed: int
    """Seed of the situation."""
    plant: str
    """Kind of actuator, one of ``plants.names()``."""
    reference: str
    """One of ``REFERENCES``."""
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    """Ranges of drive and output assumed by the user."""
    x_limits: tuple[float, float]
    """Range of the amplifier."""
    y_ref: Vector
    """The reference, in the unit of the output. Shape (N,)."""
    sample_time: float
    actuator_options: dict[str, Any]
    sensor_options: dict[str, Any]

    @classmethod
    def draw(cls, seed: int, duration_s: float, sample_time: float, reference: str | None = None) -> Situation:
        """Draw everything from the seed; a reference may be chosen.

        The assumed ranges are those measured in one drive up and down, with errors of up to 5 %.
        """
        # One generator per part, so that changes of one part do not affect the others.
        of_plant, of_sensor, of_reference, of_user = (np.random.default_rng([seed, part]) for part in range(4))
        kind = str(of_plant.choice(plants.names()))
        low, span = of_plant.uniform(-200.0, 50.0), of_plant.uniform(40.0, 1000.0)
        y_low, y_span = of_plant.uniform(-50.0, 50.0), math.exp(of_plant.uniform(math.log(2.0), math.log(200.0)))
        rates = tuple(10.0 ** of_plant.uniform(-1.5, 2.0, int(of_plant.integers(1, 5))))
        options = {
            "x_range": (low, low + span),
            "y_range": (y_low, y_low + y_span),
            "sample_time": sample_time,
            "creep_share": of_plant.uniform(0.0, 0.08),
            "creep_rates_per_s": rates,
            **INDIVIDUALS[kind](of_plant),
        }
        seen = plants.get(kind, **options).run(
            np.interp(np.arange(6001), (0, 2000, 4000, 6000), (low, low + span, low, low + span))
        )
        bottom, top = float(seen[2000:].min()), float(seen[2000:].max())
        stroke = top - bottom

        sensor = {
            "noise_um": stroke * 10.0 ** of_sensor.uniform(-4.5, -3.3),
            "offset_um": stroke * of_sensor.uniform(-0.02, 0.02),
            "seed": _seed(of_sensor),
        }
        for option, value in (
            ("quantum_um", stroke * 10.0 ** of_sensor.uniform(-4.5, -3.5)),
            ("lag_s", 10.0 ** of_sensor.uniform(-4.5, -3.3)),
            ("delay_samples", int(of_sensor.integers(1, 3))),
            ("gain_swing", 10.0 ** of_sensor.uniform(-4.0, -2.5)),
            ("gap_samples", int(of_sensor.integers(1, 200))),
        ):
            if of_sensor.random() < 0.4:
                sensor[option] = value
        sensor |= {
            "gain_swing_period_s": of_sensor.uniform(20.0, 200.0),
            "gap_period_samples": int(of_sensor.integers(1000, 20000)),
        }

        name = reference or str(of_reference.choice(list(REFERENCES)))
        used = of_reference.uniform(0.5, 0.94) * stroke
        least = bottom + 0.03 * stroke + of_reference.uniform() * (0.94 * stroke - used)
        y_ref = REFERENCES[name](
            of_reference,
            duration_s=duration_s,
            sample_time=sample_time,
            low=least + sensor["offset_um"],
            high=least + used + sensor["offset_um"],
        )
        x_error, y_error = (of_user.uniform(-0.05, 0.05, 2) * width for width in (span, stroke))
        return cls(
            seed,
            kind,
            name,
            (low + x_error[0], low + span + x_error[1]),
            (bottom + y_error[0], top + y_error[1]),
            (low, low + span),
            y_ref,
            sample_time,
            options,
            sensor,
        )

    def sensor(self) -> DisturbedSensor:
        """The actuator with its sensor, at rest at the low end."""
        return DisturbedSensor(plants.get(self.plant, **self.actuator_options), **self.sensor_options)

    def structure(self, n: int = 5, m: int = 3, offset: bool = True) -> ModelStructure:
        """The equidistant structure over the ranges assumed by the user."""
        return ModelStructure.equidistant(
            n, m, self.x_range, self.y_range, CREEP_RATES, self.sample_time, offset=offset
        )
