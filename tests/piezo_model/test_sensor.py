"""The sensor of a plant: the size of each of its errors, and their repeatability."""

import numpy as np
import pytest
from driven_plants import TS, bare, walk

from piezo_model import plants


def added(size=50_000, **options):
    """Error of the sensor of a plant at rest."""
    still = plants.get("bouc_wen", sample_time=TS, creep_share=0.0).run(np.zeros(size))
    return plants.Sensor(plants.get("bouc_wen", sample_time=TS, creep_share=0.0), **options).run(0.0 * still) - still


def test_the_noise_has_its_standard_deviation_and_is_white():
    m = added(noise_um=0.02, seed=1)
    assert m.mean() == pytest.approx(0.0, abs=5e-4)
    assert m.std() == pytest.approx(0.02, rel=0.02)
    assert abs(np.corrcoef(m[1:], m[:-1])[0, 1]) < 0.02


def test_the_same_seed_gives_the_same_noise_and_another_seed_another():
    one, same, twice, other = (
        added(100, noise_um=size, seed=seed) for seed, size in ((1, 0.02), (1, 0.02), (1, 0.04), (2, 0.02))
    )
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)
    np.testing.assert_allclose(twice, 2.0 * one, rtol=1e-10)


def test_the_gain_drifts_about_the_centre_of_the_range():
    t, plant = np.arange(3000) * TS, plants.get("bouc_wen", sample_time=TS, creep_share=0.0)
    away = plant.run(np.zeros(3000)) - np.mean(plant.y_range)
    np.testing.assert_allclose(added(3000, gain_drift_per_s=0.01), away * 0.01 * t, atol=1e-12)
    swing = added(3000, gain_swing=0.1, gain_swing_period_s=2.0)
    np.testing.assert_allclose(swing, away * 0.1 * np.sin(np.pi * t), atol=1e-12)


def test_the_measurement_is_the_nearest_multiple_of_the_quantum():
    x = walk()
    y = bare("relay_preisach").run(x)
    m = plants.Sensor(bare("relay_preisach"), quantum_um=0.05).run(x)
    np.testing.assert_allclose(m / 0.05, np.round(m / 0.05), atol=1e-9)
    assert np.abs(m - y).max() <= 0.025 + 1e-12
    assert (m - y).std() == pytest.approx(0.05 / np.sqrt(12.0), rel=0.1)


def test_a_delayed_measurement_is_the_earlier_displacement_and_starts_with_the_first():
    x = walk()
    y = bare("bouc_wen").run(x)
    m = plants.Sensor(bare("bouc_wen"), delay_samples=4).run(x)
    np.testing.assert_array_equal(m[4:], y[:-4])
    np.testing.assert_array_equal(m[:4], np.full(4, y[0]))


def test_a_sensor_without_options_measures_the_displacement_itself():
    x = walk()
    np.testing.assert_array_equal(plants.Sensor(bare("bouc_wen")).run(x), bare("bouc_wen").run(x))


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("noise_um", -1.0),
        ("quantum_um", np.nan),
        ("delay_samples", -1),
        ("delay_samples", 1.5),
        ("seed", -1),
        ("gain_drift_per_s", np.inf),
        ("offset_um", np.nan),
        ("gain_swing", np.nan),
        ("gain_swing_period_s", 0.0),
    ],
)
def test_a_sensor_refuses_a_wrong_option_by_its_name(option, value):
    with pytest.raises(ValueError, match=option):
        plants.Sensor(bare("bouc_wen"), **{option: value})


def test_the_lag_is_one_of_first_order_and_gaps_come_at_their_time():
    x, tau, begin = np.repeat([0.0, 150.0], [100, 900]), 0.05, 100
    still, lagging = bare("duhem"), plants.Sensor(bare("duhem"), lag_s=tau)
    y, m = still.run(x), lagging.run(x)
    t = np.arange(300) * TS
    away = (y[begin : begin + 300] - m[begin : begin + 300]) / (y[begin] - y[0])
    np.testing.assert_allclose(away, np.exp(-(t + TS) / tau), atol=0.02)  # the creep continues
    m = plants.Sensor(bare("duhem"), gap_samples=3, gap_period_samples=50).run(x)
    assert np.flatnonzero(np.isnan(m)).tolist() == [k for k in range(1000) if k % 50 >= 47]
