"""Signals for the exported C and the drives that Python computes, with faults of every kind; and programs of the C.

References leave the range, are NaN and infinite; the actuator of the loops is a model of another structure with noise.
"""

import subprocess
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from programs import program

from bench.export.building import write_files
from bench.export.c_source import export
from bench.export.settings import SOLVERS, ExportSettings
from piezo_model import (
    Compensator,
    Dynamics,
    HysteresisCreepModel,
    ModelStructure,
    OperatorState,
    SelfLearningCompensator,
)

SHORT, MILLION = 50_000, 1_000_000
SAMPLE_TIME = 125e-6
LIMITS = (5.0, 145.0)
DYNAMICS = Dynamics((400.0, 1100.0), (0.01, 0.02), (0.8, 0.15), 1.3 * SAMPLE_TIME, 3e-5)
PHASES = {"reset_s": 0.1, "build_s": 2.0, "learn_s": 0.7}


def a_model(
    n: int = 5, m: int = 3, rates: tuple[float, ...] = (100.0, 1.0, 0.1), offset: bool = False, seed: int = 0
) -> HysteresisCreepModel:
    """A model whose weights a piezo stack could have."""
    structure = ModelStructure.equidistant(
        n=n, m=m, x_range=(0.0, 150.0), y_range=(-20.0, 20.0), creep_rates=rates, sample_time=SAMPLE_TIME, offset=offset
    )
    rng, v = np.random.default_rng(seed), np.zeros(structure.d)
    H, S, K = structure.slices
    v[H], v[S] = rng.uniform(0.0, 0.5 / (n + 1), n), rng.uniform(0.8, 1.3, structure.dead_zones)
    v[K] = rng.uniform(0.0, 0.1 / (n + 1), structure.creep_weights)
    if offset:
        v[-1] = 0.03
    return HysteresisCreepModel.from_weights(structure, structure.slope_map @ v)


def references(size: int, seed: int = 1) -> np.ndarray:
    """Slow and fast sines over most of the range, with spikes beyond it, NaN, infinities and huge numbers."""
    k, rng = np.arange(size), np.random.default_rng(seed)
    t = k * SAMPLE_TIME
    y = 14.0 * np.sin(2 * np.pi * 7.3 * t) * np.cos(2 * np.pi * 0.37 * t) + 4.0 * np.sin(2 * np.pi * 31.0 * t)
    y[rng.integers(0, size, size // 500)] *= 4.0
    for value in (np.nan, np.inf, -np.inf, 1e30):
        y[rng.integers(0, size, size // 2000)] = value
    return y


@dataclass(frozen=True)
class Expected:
    """Input of an export, and its expected drives and events."""

    model: HysteresisCreepModel
    settings: ExportSettings
    samples: np.ndarray
    x: np.ndarray
    events: tuple[int, ...] = ()


@cache
def compensation(size: int, dynamics: Dynamics | None = None) -> Expected:
    """A compensator that reaches its limits of drive and rate."""
    model, y_ref = replace(a_model(), dynamics=dynamics), references(size)
    x = Compensator(model, x_limits=LIMITS, rate_limit=2e5).run(y_ref)
    assert {LIMITS[0], LIMITS[1]} <= set(x.tolist())
    return Expected(model, ExportSettings(x_limits=LIMITS, rate_limit=2e5), y_ref, x)


class Stage:
    """An actuator with noise, and optionally with dynamics, a faulty sensor or one of negative gain."""

    def __init__(self, size: int, faulty: bool, gain: float = 1.0, dynamics: Dynamics | None = None) -> None:
        self.dynamics = None if dynamics is None else dynamics.stream(SAMPLE_TIME)
        self.model = a_model(n=9, m=2, rates=(30.0, 0.5), seed=7)
        self.state = OperatorState.settled_at(self.model.structure, self.model.structure.x_centre)
        self.noise = 0.03 * np.random.default_rng(3).standard_normal(size)
        self.faulty, self.gain, self.done = faulty, gain, 0

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Measured output for samples of the drive."""
        k = np.arange(self.done, self.done + x.size)
        self.done += x.size
        y, self.state = self.model.advance(x, self.state)
        y = y if self.dynamics is None else self.dynamics(y)
        y = self.gain * y + self.noise[k]
        if self.faulty:
            y[k % 9000 == 5] = np.nan
            y[k % 25000 == 7] = 30.0  # implausible
            y[(k >= 30_000) & (k < 30_400)] = 3.0  # frozen
            y[(k >= 40_000) & (k < 42_000)] += 8.0  # a plug pulled and put back
            y[(k >= 46_000) & (k < 47_000)] = -np.inf
        return y


LOOPS = (*SOLVERS, "continuous")
"""The solvers in cyclic mode, and continuous mode."""


def loop_of(kind: str) -> dict[str, str]:
    """Solver and mode."""
    continuous = kind == "continuous"
    return {"solver": "box_active_set" if continuous else kind, "mode": "continuous" if continuous else "cyclic"}


@cache
def learning(
    solver: str,
    size: int,
    faulty: bool = False,
    integral_gain: float = 0.0,
    gain: float = 1.0,
    structure: ModelStructure | None = None,
    dynamics: Dynamics | None = None,
) -> Expected:
    """The self-learning loop on a stage, of one of LOOPS, from a model of another stage or, of a given structure, from
    the straight line."""
    structure, w = (structure, structure.straight_line) if structure else (a_model().structure, a_model(seed=3).weights)
    start = replace(HysteresisCreepModel.from_weights(structure, w), dynamics=dynamics)
    loop = loop_of(solver)
    learner = SelfLearningCompensator(
        start.structure,
        **loop,
        x_limits=LIMITS,
        model=start,
        solve_delay_samples=1,
        integral_gain=integral_gain,
        **PHASES,
    )
    y_ref, stage = references(size, seed=2), Stage(size, faulty, gain, dynamics)
    x, y = learner.run(y_ref[:-1], stage)
    events = learner.counts["hand_overs"], learner.counts["refusals"]
    x = np.append(x, learner.step(y_ref[-1], np.nan))  # as in C, nothing is observed after the last drive
    settings = ExportSettings(part="learning", x_limits=LIMITS, integral_gain=integral_gain, **loop, **PHASES)
    return Expected(start, settings, np.column_stack([y_ref, np.concatenate([[np.nan], y])]), x, events)


def write_sources(folder: Path, model: HysteresisCreepModel, settings: ExportSettings) -> None:
    """Write the export to an existing folder."""
    write_files(folder, export(model, settings))


def build(folder: Path, source: str, compiler: str, *flags: str) -> Path:
    """Build a program of this folder, replay.c or emulated.c, with the export in another."""
    target = folder / source.removesuffix(".c")
    units = [Path(__file__).with_name(source), *sorted(folder.glob("piezo*.c"))]
    subprocess.run([program(compiler), "-std=c99", *flags, "-I", folder, *units, "-o", target, "-lm"], check=True)
    return target


def replay(built: Path, samples: np.ndarray) -> tuple[np.ndarray, tuple[int, ...]]:
    """Drives (N,) for references (N,), with learning (N, 2) beside them the outputs measured before.

    With learning the events, too: hand-overs, refusals, faults of the sensor, numerical faults, late offers, dropped
    blocks.
    """
    source, target = built.with_suffix(".in"), built.with_suffix(".out")
    np.ascontiguousarray(samples, dtype=np.float64).tofile(source)
    done = subprocess.run([built, source, target], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.fromfile(target), tuple(map(int, done.stderr.split()))
