"""Endurance runs of self-learning compensators and a bank: error, memory and counters over millions of samples."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from piezo_model import (
    CompensatorBank,
    HysteresisCreepModel,
    ModelStructure,
    OperatorState,
    SelfLearningCompensator,
    plants,
)
from solvers.arrays import Matrix

T = 125e-6
PIECE = 80_000
"""Period of the references in samples, ten seconds."""
DAY = 700_000_000
"""Samples of a day at 8 kHz."""
LOOPS = ("continuous", "cyclic", "bank")
ACTUATORS = 16
NOISE_UM = 0.008


def structure() -> ModelStructure:
    return ModelStructure.equidistant(5, 3, (0.0, 150.0), (-20.0, 20.0), (10.0, 1.0, 0.1), T)


def references(count: int) -> Matrix:
    """One period (PIECE, count) of sines of changing amplitude, a different one for each actuator, µm."""
    t, number = 2.0 * np.pi * np.arange(PIECE)[:, None] / PIECE, np.arange(count)
    found: Matrix = 15.0 * np.sin((40 + 7 * number) * t) * (0.7 + 0.3 * np.sin((3 + number) * t))
    return found


def resident_bytes() -> int:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096


@dataclass
class Soak:
    """Results: RMS error of each stretch, memory after it, and the integer counters at the end as (value, bits)."""

    rms_um: list[float] = field(default_factory=list)
    resident: list[int] = field(default_factory=list)
    counters: dict[str, tuple[int, int]] = field(default_factory=dict)


class Loop:
    """A self-learning compensator of a plant that is not in the model class."""

    def __init__(self, mode: Literal["continuous", "cyclic"]) -> None:
        plant = plants.Sensor(plants.get("relay_preisach"), noise_um=NOISE_UM)
        self.plant, s = plant, structure()
        self.learner = SelfLearningCompensator(
            s,
            0.1,
            8.0,
            1.9,
            "box_active_set",
            mode=mode,
            hand_over_s=0.1,
            estimate_offset=False,
            state=OperatorState.settled_at(s, s.x_range[0], came_from="above"),
        )
        self.y_ref = references(1)[:, 0]

    def piece(self) -> float:
        """Mean squared error of the next period."""
        _, y = self.learner.run(self.y_ref, self.plant.run)
        return float(np.mean((y - self.y_ref) ** 2))

    def counters(self) -> dict[str, tuple[int, int]]:
        found = {"sample": (self.learner.samples, 64)}
        found |= {name: (int(self.learner._memory[name]), 53) for name in ("faults", "failures", "fault_count")}
        return found | {name: (count, 53) for name, count in self.learner.counts.items()}


def tile_samples(bank: CompensatorBank) -> NDArray[np.int64]:
    """Sample counter of each tile of a bank."""
    offsets, block = bank._core.offsets, bank._core.block
    at, width = offsets["mailbox"][0] + 16, 8 * offsets["driver"][1]  # behind two sizes and the delay
    return np.array([block[at + tile * width :][:8].view(np.int64)[0] for tile in range(bank._tiles)])


class Bank:
    """A bank whose actuators have more operators than its models, and individual weights."""

    def __init__(self, count: int = ACTUATORS) -> None:
        self.bank, self.y_ref = CompensatorBank(structure(), count, hand_over_s=0.1), references(count)
        self.random = np.random.default_rng(1)
        wide = ModelStructure.equidistant(9, 3, (0.0, 150.0), (-20.0, 20.0), (30.0, 3.0, 0.3), T)
        self.models, self.states = [], [OperatorState.settled_at(wide, wide.x_centre) for _ in range(count)]
        for _ in range(count):
            w_H = np.r_[1.0, self.random.uniform(0.0, 0.1, 9)]
            w_K, w_S = self.random.uniform(0.0, 0.02, 10), np.r_[0.02, 0.03, 0.02, 1.0, 0.03, 0.02, 0.04]
            self.models.append(HysteresisCreepModel(wide, w_H / w_H.sum(), w_S, w_K, 0.0))
        self.before = np.full(count, math.nan)

    def actuators(self, x: Matrix) -> Matrix:
        y = np.empty_like(x)
        for i, model in enumerate(self.models):
            y[:, i], self.states[i] = model.advance(x[:, i], self.states[i])
        return y + self.random.normal(scale=NOISE_UM, size=y.shape)

    def chunks(self) -> Iterator[slice]:
        """Parts of a period in which weights change at the first sample only."""
        done = 0
        while done < PIECE:
            # weights change one block after the end of an interval
            late = (tile_samples(self.bank) - self.bank.block) % self.bank.interval
            end = min(done + max(1, self.bank.interval - 1 - int(late.max())), PIECE)
            yield slice(done, end)
            done = end

    def piece(self) -> float:
        squares = 0.0
        for part in self.chunks():
            y_ref, memory = self.y_ref[part], self.bank.get_state()
            first = self.bank.step(y_ref[0], self.before)
            self.bank.learning = False
            x = np.vstack([first, self.bank.run(y_ref[1:])])
            y = self.actuators(x)
            self.bank.restore(memory)
            again = self.bank.run(y_ref, np.vstack([self.before[None], y[:-1]]))
            if not np.array_equal(again, x):
                raise AssertionError("the drive depends on the outputs although no weights may change")
            self.before = y[-1].copy()
            squares += float(np.sum((y - y_ref) ** 2))
        return squares / self.y_ref.size

    def counters(self) -> dict[str, tuple[int, int]]:
        found = {"sample": (int(tile_samples(self.bank).max()), 64)}
        return found | {name: (int(value.max()), 53) for name, value in self.bank.counts.items()}


def soak(kind: str, samples: int, stretch: int) -> Soak:
    """Run a number of samples in stretches of whole periods, after ten periods of learning."""
    loop = Bank() if kind == "bank" else Loop("continuous" if kind == "continuous" else "cyclic")
    found, pieces = Soak(), stretch // PIECE
    for _ in range(10):
        loop.piece()
    for _ in range(samples // stretch):
        found.rms_um.append(math.sqrt(sum(loop.piece() for _ in range(pieces)) / pieces))
        found.resident.append(resident_bytes())
    found.counters = loop.counters()
    return found
