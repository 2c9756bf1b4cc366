import numpy as np
import pytest

from piezo_model.identification.sensor_lag import HALF_WIDTH, minimise_over_lag, shift_output


def displacement(k: np.ndarray) -> np.ndarray:
    """A signal known between the samples as well, up to a third of the highest frequency that sampling holds."""
    return 20 * np.sin(0.03 * k) + 3 * np.cos(0.4 * k + 1) + 0.5 * np.sin(1.0 * k) - 96


@pytest.mark.parametrize("lag", [0.5, -0.5, 40.5, -40.5])
def test_a_fraction_keeps_every_sample_that_has_its_neighbours(lag: float) -> None:
    _, kept = shift_output(np.arange(300.0), lag)
    assert kept.start == max(0, np.ceil(HALF_WIDTH - 1 - np.floor(lag)))
    assert kept.stop - 1 == min(299, np.floor(299 - HALF_WIDTH - np.floor(lag)))


def test_the_lowest_of_several_valleys_is_found_without_asking_twice() -> None:
    asked: list[float] = []
    found = minimise_over_lag(lambda at: asked.append(at) or np.cos(2.2 * at) + 0.05 * (at - 7) ** 2, 12)
    assert found.samples == pytest.approx(7.11, abs=0.05)
    assert len(asked) == len(set(asked)) < 40
    assert (min(asked), max(asked)) == (0, 12)


@pytest.mark.parametrize(
    ("cost", "max_lag", "sentence"),
    [
        (lambda at: at, -1, "max_lag must be a finite number of samples from 0 up"),
        (lambda at: at, np.inf, "max_lag must be a finite number"),
        (lambda at: at, np.nan, "max_lag must be a finite number"),
        (lambda at: np.nan if at == 2 else at, 4, "not a number at a lag of 2 samples"),
    ],
)
def test_a_search_that_makes_no_sense_is_refused(cost, max_lag: float, sentence: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match=sentence):
        minimise_over_lag(cost, max_lag)


@pytest.mark.parametrize("lag", [0.25, 0.5, 1.9, -0.4, -3.75, 10.01])
def test_a_shifted_signal_is_the_signal_between_its_samples(lag: float) -> None:
    k = np.arange(500)
    values, kept = shift_output(displacement(k), lag)
    np.testing.assert_allclose(values, displacement(k[kept] + lag), atol=1e-4)


@pytest.mark.parametrize("lag", [0, 1, 7, -3])
def test_whole_samples_move_without_arithmetic_and_trim_no_more_than_the_lag(lag: int) -> None:
    y = np.random.default_rng(1).normal(size=100)
    values, kept = shift_output(y, lag)
    np.testing.assert_array_equal(values, y[np.arange(100)[kept] + lag])
    assert values.size == 100 - abs(lag)


@pytest.mark.parametrize("lag", [0.5, 2.3])
def test_an_offset_stays_and_a_ramp_stays_straight(lag: float) -> None:
    k = np.arange(200.0)
    np.testing.assert_allclose(shift_output(np.full(200, -96.0), lag).values, -96.0, rtol=1e-14)
    values, kept = shift_output(k, lag)
    np.testing.assert_allclose(values, k[kept] + lag, atol=1e-4)


def test_a_shift_by_half_a_sample_keeps_the_noise_so_that_it_does_not_look_like_a_better_fit() -> None:
    noise = np.random.default_rng(2).normal(size=50_000)
    assert np.var(shift_output(noise, 0.5).values) > 0.95 * np.var(noise)


@pytest.mark.parametrize(
    ("y", "lag", "sentence"),
    [
        (np.zeros(5), 5, "5 samples are too few to be shifted by 5"),
        (np.zeros(5), -7, "too few"),
        (np.zeros(60), 0.5, "60 samples are too few to be shifted by 0.5"),
        (np.zeros(0), 0, "too few"),
        (np.zeros((3, 3)), 1, "one-dimensional"),
        (np.zeros(5), np.nan, "finite number of samples, not nan"),
    ],
)
def test_a_shift_that_leaves_nothing_is_refused(y: np.ndarray, lag: float, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        shift_output(y, lag)


@pytest.mark.parametrize("lag", [0.0, 0.3, 1.0, 2.5, 4.98, 5.0])
def test_the_bottom_of_a_valley_is_found(lag: float) -> None:
    found = minimise_over_lag(lambda at: 1 + abs(at - lag) ** 1.5, 5.0)
    assert found.samples == pytest.approx(lag, abs=0.02)
    assert found.error_without_lag_percent <= found.error_percent == pytest.approx(1 + lag**1.5)
    assert found.at_edge == (lag == 5.0)
