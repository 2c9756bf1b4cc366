"""The C core of compensators: lanes of a bank beside single ones, damaged memories, and threads."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import python
from learning_loops import MODES, FaultySensor, T, Vector, learner_for, sensor, structure_for

from piezo_model import (
    CompensatorBank,
    DataBasis,
    Dynamics,
    HysteresisCreepModel,
    ModelStructure,
    SelfLearningCompensator,
    plants,
)

SAMPLES, COUNT = 12_000, 8
"""One tile, which starts at the same sample as a single learner."""
REVERSED = 4
"""Its actuator whose output falls as the input rises."""


RINGING = [Dynamics((30.0 + i, 90.0), (0.01, 0.02), (0.8, 0.15), 0.3 * i * T, 0.1 * i * T) for i in range(COUNT)]


def recorded(plant: plants.Plant, faulty: bool, rings: bool) -> tuple[Vector, Vector]:
    """References and measured outputs of eight actuators, some with failing sensors."""
    t, number = np.arange(SAMPLES)[:, None] * T, np.arange(COUNT)
    y_range, x_range = np.array(plant.y_range), np.array(plant.x_range)
    wave = 0.9 * np.sin(2 * np.pi * (1.3 + 0.2 * number) * t) * np.cos(2 * np.pi * 0.11 * t)
    y = np.empty_like(wave)
    for i in range(COUNT):
        stage = plants.get("relay_preisach", sample_time=T)
        stage = plants.Flexure(stage, replace(RINGING[i], amplifier_lag_s=0.0)) if rings else stage
        actuator = plants.Sensor(stage, noise_um=2e-4 * np.ptp(y_range), seed=i)
        measure = FaultySensor(actuator, seed=i) if faulty and i % 2 else actuator.run
        y[:, i] = measure(x_range.mean() + 0.45 * np.ptp(x_range) * wave[:, i])
    return y_range.mean() + 0.5 * np.ptp(y_range) * wave, y


@pytest.mark.parametrize(
    ("n", "m", "offset", "faulty", "rings", "integral_gain"),
    [
        (5, 3, False, False, False, 0.0),
        (9, 2, True, True, False, 20.0),
        (5, 3, True, True, True, 0.0),
        (9, 2, False, False, True, 20.0),
    ],
)
def test_each_lane_drives_and_learns_like_a_single_compensator_of_its_dynamics_to_the_last_bit(
    n: int, m: int, offset: bool, faulty: bool, rings: bool, integral_gain: float, tmp_path: Path
) -> None:
    plant = plants.get("relay_preisach", sample_time=T)
    structure = ModelStructure.equidistant(n, m, plant.x_range, plant.y_range, (100.0, 10.0, 1.0), T, offset=offset)
    line = HysteresisCreepModel.from_weights(structure, structure.straight_line)
    y_ref, y = recorded(plant, faulty, rings)
    y[:, REVERSED] = sum(plant.y_range) - y[:, REVERSED]
    models = [replace(line, dynamics=dynamics) for dynamics in (RINGING if rings else [None] * COUNT)]
    before = np.vstack([np.full(COUNT, np.nan), y[:-1]])
    options = {"hand_over_s": 0.1, "integral_gain": integral_gain, "rate_limit": 3e4}
    x_start = np.linspace(0.0, 150.0, COUNT)
    bank = CompensatorBank(structure, COUNT, x_start=x_start, dynamics=models[0].dynamics, **options)
    for i in range(COUNT):
        bank.set_model(i, models[i])
    middle = SAMPLES // 2 + 7
    x = bank.run(y_ref[:middle], before[:middle])
    bank.save(tmp_path / "bank.npz")
    bank = CompensatorBank.load(tmp_path / "bank.npz")
    x = np.vstack([x, bank.run(y_ref[middle:], before[middle:])])
    for i in range(COUNT):
        single = SelfLearningCompensator(
            structure,
            mode="continuous",
            model=models[i],
            estimate_offset=False,
            adapt_range=False,
            x_start=x_start[i],
            **options,
        )
        assert single._block == bank.block
        np.testing.assert_array_equal(single.replay(y_ref[:, i], before[:, i]), x[:, i])
        assert {name: counts[i] for name, counts in bank.counts.items()} == {
            name: single._memory[name] for name in bank.counts
        }
        assert (single.counts["hand_overs"] > 5, single.counts["reversed"] > 0) == (i != REVERSED, i == REVERSED)
        assert (single._memory["faults"] > 0) == (faulty and i % 2 == 1)
    bank.remove(2)
    assert [model.dynamics for model in bank.models] == [model.dynamics for model in models[:2] + models[3:]]


HOSTILE = [np.array([value]).view(np.uint8) for value in (-1, 2**31 - 1, 2**62, 7, np.nan, np.inf, 1e300, -1e-300)]


def restored_or_refused(kind: str) -> tuple[int, int]:
    """Numbers of damaged memories that a learner or bank refuses, and with which it runs inside the limits, of 200."""
    random, refused, plant = np.random.default_rng(0), 0, sensor()
    y = np.linspace(*plant.y_range, 1500)[np.abs(np.arange(3000) % 400 - 200) * 7]
    if kind == "bank":
        one: Any = CompensatorBank(structure_for(plant, n=3, m=1, offset=False), 8, hand_over_s=0.05)
        run, y = one.run, np.tile(y[:, None], 8)
    else:
        one = learner_for(plant, kind, build_s=0.5, x_limits=plant.x_range)
        run = one.replay
    run(y, 0.9 * y)
    good = one.get_state()
    for _ in range(200):
        damaged = one.get_state()
        core = damaged.get("learning", damaged)["core"]
        for _ in range(int(random.integers(1, 4))):
            first = 8 * int(random.integers(0, (600 if random.random() < 0.5 else core.size) // 8))
            core[first : first + 8] = HOSTILE[int(random.integers(len(HOSTILE)))]
        try:
            one.restore(damaged)
        except ValueError:
            refused += 1
            continue
        x = run(y[:150], y[:150])
        assert plant.x_range[0] <= x.min() <= x.max() <= plant.x_range[1], "the drive left its limits"
        one.restore(good)
    return refused, 200 - refused


@pytest.mark.parametrize("kind", [*MODES, "bank"])
def test_a_damaged_memory_is_refused_or_drives_inside_the_limits(kind: str) -> None:
    program = f"import test_model_core; print(*test_model_core.restored_or_refused({kind!r}))"
    refused, ran = map(int, python("-c", program).stdout.split())
    assert refused > 50
    assert ran > 10


def test_a_second_thread_is_refused_while_the_first_is_at_work() -> None:
    basis, x = DataBasis(structure_for(sensor(), n=30, m=9)), np.sin(np.arange(300_000) / 50.0)

    with ThreadPoolExecutor(3) as pool:
        updates = [pool.submit(basis.update, x, x) for _ in range(9)]
    said = [str(update.exception() or "") for update in updates]
    assert {*said} == {"", "it is in use by another thread; give each thread one of its own"}
    assert basis.samples == said.count("") * x.size
