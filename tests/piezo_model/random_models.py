"""Valid models, operator states and drives for property tests, generated from one integer that Hypothesis draws and
shrinks."""

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from numpy.random import Generator
from plain_model import rows

from piezo_model import HysteresisCreepModel, ModelStructure, OperatorState
from solvers.arrays import Mask, Vector

FREE = (-np.inf, np.inf)
"""Limits of a drive without limits."""


@dataclass
class Case:
    """A model with states of its operators."""

    model: HysteresisCreepModel
    state: OperatorState
    rng: Generator

    @property
    def structure(self) -> ModelStructure:
        return self.model.structure

    @property
    def x_tolerance(self) -> float:
        """1e-12 of the range plus the spacing of floating-point numbers in the range."""
        return 1e-12 * self.structure.x_scale + 4 * float(
            np.spacing(abs(self.structure.x_centre) + self.structure.x_scale)
        )

    @property
    def y_tolerance(self) -> float:
        return 1e-12 * self.structure.y_scale + 4 * float(
            np.spacing(abs(self.structure.y_centre) + self.structure.y_scale)
        )

    def reference(self, size: int = 120) -> Vector:
        return self.structure.y_centre + self.structure.y_scale * drive(self.rng, size)

    def a_drive(self, size: int = 120) -> Vector:
        return self.structure.x_centre + self.structure.x_scale * drive(self.rng, size)

    def recording(self, size: int) -> tuple[Vector, Vector]:
        """A drive and an output that covers its whole range."""
        return self.a_drive(size), self.structure.y_centre + self.structure.y_scale * 1.2 * drive(self.rng, size)

    def program(self, x: Vector, y: Vector, counted: Mask, forgetting: float) -> tuple[Vector, Vector, float]:
        """P, q and c of equation (6) from a dense matrix of all rows."""
        s, size = self.structure, self.structure.n + 1
        unit_x, unit_y = (x - s.x_centre) / s.x_scale, (y - s.y_centre) / s.y_scale
        Xi = rows(s.to_dict(), unit_x, unit_y, self.state.play[:size], self.state.creep.reshape(-1, s.lanes)[:, :size])
        Xi, x = Xi[counted], unit_x[counted]
        weight = forgetting ** np.arange(x.size - 1.0, -1.0, -1.0)
        weighted = Xi * weight[:, None]
        return weighted.T @ Xi / weight.sum(), weighted.T @ x / weight.sum(), 0.5 * float(weight @ x**2) / weight.sum()


def ascending(rng: Generator, count: int) -> Vector:
    """Thresholds above zero, unevenly spaced over the range."""
    gaps = rng.uniform(0.2, 1.0, count)
    return np.cumsum(gaps) / max(gaps.sum(), 1.0) * rng.uniform(0.7, 1.2)


def structure_of(rng: Generator, n: int, below: int, above: int, rates: int, offset: bool) -> ModelStructure:
    dead_zones = (*(-ascending(rng, below))[::-1], 0.0, *ascending(rng, above))
    creep_rates = 10.0 ** rng.permutation(np.arange(-1.0, 4.0))[:rates]
    (x_centre, y_centre), (x_scale, y_scale) = rng.uniform(-100, 100, 2), rng.uniform(0.1, 100, 2)
    return ModelStructure(
        tuple(ascending(rng, n)),
        dead_zones,
        tuple(creep_rates),
        10 ** rng.uniform(-5, -3),
        x_centre,
        x_scale,
        y_centre,
        y_scale,
        offset,
    )


def model_of(rng: Generator, s: ModelStructure) -> HysteresisCreepModel:
    """Hysteresis and curvature up to several times those of piezo ceramics, creep up to half the instantaneous gain."""
    w_H = np.concatenate([[rng.uniform(0.5, 2)], rng.uniform(0, 1, s.n) * rng.integers(0, 2, s.n) / max(s.n / 3, 1)])
    v = np.zeros(s.d)
    v[s.slices[1]] = rng.uniform(0.3, 2, s.dead_zones)
    w_K = rng.uniform(0, 0.5, s.creep_weights) * w_H[0] / max(s.creep_weights * len(s.creep_rates), 1)
    return HysteresisCreepModel(
        s, w_H, (s.slope_map @ v)[s.slices[1]], w_K, rng.uniform(-0.5, 0.5) if s.offset else 0.0
    )


def state_of(rng: Generator, s: ModelStructure) -> OperatorState:
    """Reachable states: neighbouring plays differ by no more than their thresholds do."""
    state = OperatorState.settled_at(s, s.x_centre + s.x_scale * rng.uniform(-1, 1))
    state.play[1 : s.n + 1] = state.play[0] + np.cumsum(rng.uniform(-1, 1, s.n) * np.diff((0.0, *s.play_thresholds)))
    state.creep[:] = rng.uniform(-1, 1, state.creep.size)
    return state


def drive(rng: Generator, size: int) -> Vector:
    """In normalised units: a wandering sine with jumps and plateaus."""
    k = np.arange(size)
    x = np.sin(k * rng.uniform(0.02, 0.5)) * rng.uniform(0.2, 1) + 0.3 * np.sin(k * rng.uniform(0.001, 0.05))
    x[rng.integers(0, size, size // 10)] = rng.uniform(-1, 1, size // 10)
    start = rng.integers(0, size)
    x[start : start + size // 8] = x[start]
    return x


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Any n to 20, any number of dead zones to 8 on each side, 0 to 4 creep rates, with and without offset."""
    n, below, above = draw(st.integers(0, 20)), draw(st.integers(0, 8)), draw(st.integers(0, 8))
    rates, offset = draw(st.integers(0, 4)), draw(st.booleans())
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    s = structure_of(rng, n, below, above, rates, offset)
    return Case(model_of(rng, s), state_of(rng, s), rng)
