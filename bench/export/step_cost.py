"""What a step of the export costs: nanoseconds and instructions on this machine, memory and instructions on
controllers.

Learning is slow beside a sample: a cycle of 10 s has one block at which a phase ends. Counting instructions is slow,
too. So steps are counted over cycles of the same proportions that are as short as the samples that can be counted.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.export.building import COUNTABLE, FAST, build, instructions_per_step, replay, tool, write_sources
from bench.export.cortex_m import CORES, ControllerCost, controller_cost
from bench.export.settings import ExportError, ExportSettings
from piezo_model import Compensator, HysteresisCreepModel
from solvers.arrays import Vector

TIMED, COUNTED, LISTED = 40_000, 8_000, 256
"""Samples to time here, to count here, and at most to list under an emulator."""

NOISE = 1e-3
"""Standard deviation of the sensor's noise, unit amplitudes."""


@dataclass(frozen=True)
class StepCost:
    """What was found, and why the rest was not."""

    ns: float
    """Mean of a step in the fastest of some replays."""
    with_learning_ns: float
    """The same with a step's share of the learning."""
    instructions: float | None
    """Mean of a step."""
    learning_instructions: float | None
    """Mean of the learning a step; None without learning too."""
    axis_bytes: int
    controllers: tuple[ControllerCost, ...]
    absent: tuple[str, ...]
    """What is not there, in sentences."""


def step_cost(model: HysteresisCreepModel, settings: ExportSettings, repetitions: int = 20) -> StepCost:
    """Time and count steps; ExportError where there is no C compiler.

    Without valgrind, the cross compiler or the emulator the part that needs it is left out.
    """
    compiler, samples, absent = tool("cc", "gcc", "clang"), loop_samples(model, settings, TIMED), []
    counted, learning, controllers = None, None, []
    with tempfile.TemporaryDirectory(prefix="piezobench-cost-") as name:
        folder = Path(name)
        write_sources(folder, model, shortened(model, settings, TIMED))
        time = replay(build(folder, "replay", compiler, FAST), samples, repetitions).time
        assert time is not None
        try:
            write_sources(folder, model, shortened(model, settings, COUNTED))
            countable = build(folder, "replay", compiler, COUNTABLE)
            counted = instructions_per_step(countable, samples[:COUNTED])
            if settings.learning:
                learning = instructions_per_step(countable, samples[:COUNTED], "piezo_learn")
        except ExportError as error:
            absent.append(f"Instructions here were not counted: {error}.")
        for core in CORES:
            try:
                controllers.append(
                    controller_cost(
                        folder,
                        model,
                        in_blocks(model, settings, shortened(model, settings, LISTED)),
                        core,
                        samples[: 2 * LISTED],
                    )
                )
            except ExportError as error:
                absent.append(f"{core.name} was left out: {error}.")
    return StepCost(
        time.fastest_ns, time.with_learning_ns, counted, learning, time.axis_bytes, tuple(controllers), tuple(absent)
    )


def loop_samples(model: HysteresisCreepModel, settings: ExportSettings, count: int) -> Vector:
    """References (N,), with learning beside them the outputs measured before (N, 2).

    The actuator is the model itself and its sensor has noise; without any, the program would be degenerate and its
    active set restless.
    """
    s, k = model.structure, np.arange(count)
    y_ref = s.y_centre + s.y_scale * (0.6 * np.sin(0.013 * k) * np.cos(0.00041 * k) + 0.1 * np.sin(0.11 * k))
    if not settings.learning:
        return y_ref
    y = model.simulate(Compensator(model, settings.x_limits, settings.rate_limit).run(y_ref))
    y += NOISE * s.y_scale * np.random.default_rng(0).standard_normal(count)
    return np.column_stack([y_ref, np.concatenate([[np.nan], y[:-1]])])


def shortened(model: HysteresisCreepModel, settings: ExportSettings, samples: int) -> ExportSettings:
    """The same with a cycle of so many samples."""
    cycle_s = settings.reset_s + settings.build_s + settings.learn_s
    share = samples * model.structure.sample_time / cycle_s
    return replace(
        settings,
        name="piezo",
        reset_s=share * settings.reset_s,
        build_s=share * settings.build_s,
        learn_s=share * settings.learn_s,
    )


def in_blocks(model: HysteresisCreepModel, settings: ExportSettings, short: ExportSettings) -> ExportSettings:
    """Short cycles with phases of whole blocks, of as many samples as those of the settings have: they decide what a
    step and a block cost."""
    if not settings.cyclic:
        return short
    s, block = model.structure, settings.numbers(model.structure)["block"]
    reset_s, build_s, learn_s = (
        s.sample_time * block * max(1, round(s.samples(seconds) / block))
        for seconds in (short.reset_s, short.build_s, short.learn_s)
    )
    return replace(short, reset_s=reset_s, build_s=build_s, learn_s=learn_s)
