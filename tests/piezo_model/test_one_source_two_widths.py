"""A lane of a bank equals the single self-learning compensator: the same source, compiled for two widths."""

from pathlib import Path

import numpy as np
import pytest
from faulty_sensor import FaultySensor
from numpy.typing import NDArray

from piezo_model import CompensatorBank, ModelStructure, SelfLearningCompensator, plants

Vector = NDArray[np.float64]
T = 1e-3
SAMPLES, COUNT = 12_000, 8
"""One tile, which starts at the same sample as a single learner."""
REVERSED = 4
"""Its actuator whose output falls as the input rises."""


def structure_for(plant: plants.Plant, n: int = 5, m: int = 3, offset: bool = False) -> ModelStructure:
    return ModelStructure.equidistant(n, m, plant.x_range, plant.y_range, (100.0, 10.0, 1.0), T, offset=offset)


def recorded(plant: plants.Plant, faulty: bool) -> tuple[Vector, Vector]:
    """References and measured outputs of eight actuators, some with failing sensors."""
    t, number = np.arange(SAMPLES)[:, None] * T, np.arange(COUNT)
    y_range = np.array(plant.y_range)
    y_ref = y_range.mean() + 0.45 * np.ptp(y_range) * np.sin(2 * np.pi * (1.3 + 0.2 * number) * t) * np.cos(
        2 * np.pi * 0.11 * t
    )
    y = np.empty_like(y_ref)
    for i in range(COUNT):
        actuator = plants.Sensor(plants.get("relay_preisach", sample_time=T), noise_um=2e-4 * np.ptp(y_range), seed=i)
        sensor = FaultySensor(actuator, seed=i) if faulty and i % 2 else actuator
        x = np.mean(plant.x_range) + 0.45 * np.ptp(plant.x_range) * (y_ref[:, i] - y_range.mean()) / (
            0.5 * np.ptp(y_range)
        )
        y[:, i] = (sensor if faulty and i % 2 else sensor.run)(x)
    return y_ref, y


@pytest.mark.sample(4)
@pytest.mark.parametrize("faulty", [False, True])
@pytest.mark.parametrize("integral_gain", [0.0, 50.0])
@pytest.mark.parametrize(("n", "m", "offset"), [(5, 3, False), (9, 2, True)])
def test_each_lane_drives_and_learns_like_a_single_compensator_to_the_last_bit(
    faulty: bool, integral_gain: float, n: int, m: int, offset: bool, tmp_path: Path
) -> None:
    plant = plants.get("relay_preisach", sample_time=T)
    structure = structure_for(plant, n, m, offset)
    y_ref, y = recorded(plant, faulty)
    y[:, REVERSED] = sum(plant.y_range) - y[:, REVERSED]
    before = np.vstack([np.full(COUNT, np.nan), y[:-1]])
    options = {"hand_over_s": 0.1, "integral_gain": integral_gain, "rate_limit": 3e4}
    x_start = np.linspace(0.0, 150.0, COUNT)
    bank = CompensatorBank(structure, COUNT, x_start=x_start, **options)
    middle = SAMPLES // 2 + 7
    x = bank.run(y_ref[:middle], before[:middle])
    bank.save(tmp_path / "bank.npz")
    bank = CompensatorBank.load(tmp_path / "bank.npz")
    x = np.vstack([x, bank.run(y_ref[middle:], before[middle:])])
    for i in range(COUNT):
        single = SelfLearningCompensator(
            structure,
            mode="continuous",
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
        assert (single.counts["hand_overs"] > 5) == (i != REVERSED)
        assert (single.counts["reversed"] > 0) == (i == REVERSED)
        assert (single._memory["faults"] > 0) == (faulty and i % 2 == 1)
