import numpy as np
import pytest
from scipy.signal import sawtooth

from piezo_model import Recording, identify, plants
from piezo_model.identification.sensor_lag import HALF_WIDTH, shift_output


def displacement(k: np.ndarray) -> np.ndarray:
    """A signal that is known between the samples, too, with frequencies up to a third of the Nyquist frequency."""
    return 20 * np.sin(0.03 * k) + 3 * np.cos(0.4 * k + 1) + 0.5 * np.sin(1.0 * k) - 96


@pytest.mark.parametrize("lag", [0.4, 2.3, 6.0])
def test_a_lag_of_the_sensor_is_found_to_a_hundredth_of_a_sample(lag: float) -> None:
    k = np.arange(6000)
    recording = Recording.from_arrays(displacement(k), 2 * displacement(k - lag), 1e-3)
    found = identify(recording, n=2, m=1, creep_rates=(), force=True).report["lag"]
    assert found["samples"] == pytest.approx(lag, abs=0.01)
    assert found["error_without_lag_percent"] < 0.01 * found["error_percent"]


def of_a_stage(name: str, x: np.ndarray, lag: float = 0.0, noise_um: float = 0.02) -> Recording:
    y = plants.get(name, sample_time=1e-3).run(x)
    y = np.interp(np.arange(y.size) - lag, np.arange(y.size), y)
    return Recording.from_arrays(x, y + np.random.default_rng(4).normal(0.0, noise_um, y.size), 1e-3)


T = np.arange(6000) * 1e-3
TONES = 75.0 + 25.0 * sum(np.sin(2 * np.pi * f * T + f) for f in (0.7, 1.9, 4.3))
TRIANGLE = 75.0 * (1.0 + sawtooth(2 * np.pi * T, 0.5))


@pytest.mark.parametrize("name", ["relay_preisach", "maxwell_slip"])
@pytest.mark.parametrize("x", [TONES, TRIANGLE])
def test_a_stage_without_a_lag_is_not_said_to_have_one(name: str, x: np.ndarray) -> None:
    report = identify(of_a_stage(name, x)).report
    assert not report["lag"]["is_significant"]
    assert not any(
        "lags by" in sentence or "--lag" in sentence for sentence in [*report["findings"], *report["advice"]]
    )


@pytest.mark.parametrize("lag", [1.0, 3.0])
def test_a_lag_in_noise_is_named_with_errors_that_are_shares_of_the_full_range(lag: float) -> None:
    report = identify(of_a_stage("maxwell_slip", TONES, lag)).report
    assert report["lag"]["is_significant"]
    assert report["lag"]["samples"] == pytest.approx(lag, abs=0.3)  # creep lags, too
    assert report["lag"]["error_percent"] == pytest.approx(report["fit"]["rms_percent"], rel=0.03)
    assert report["selection"]["table"][0]["error_percent"] == pytest.approx(report["fit"]["rms_percent"], rel=0.1)


@pytest.mark.parametrize("lag", [0.25, 0.5, 1.9, -0.4, -3.75, 10.01, 40.5, 0.0, 7.0])
def test_a_shifted_signal_is_the_signal_between_its_samples_wherever_these_have_neighbours(lag: float) -> None:
    k = np.arange(500)
    values, kept = shift_output(displacement(k), lag)
    assert kept.start == max(0, np.ceil(HALF_WIDTH - 1 - np.floor(lag)))
    assert kept.stop - 1 == min(499, np.floor(499 - HALF_WIDTH - np.floor(lag)))
    np.testing.assert_allclose(values, displacement(k[kept] + lag), atol=1e-4)


def test_a_shift_by_half_a_sample_keeps_the_noise_so_that_it_does_not_look_like_a_better_fit() -> None:
    noise = np.random.default_rng(2).normal(size=50_000)
    assert np.var(shift_output(noise, 0.5)[0]) > 0.95 * np.var(noise)
