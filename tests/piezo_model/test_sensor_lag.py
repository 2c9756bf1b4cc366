import numpy as np
import pytest

from piezo_model.identification.sensor_lag import HALF_WIDTH, minimise_over_lag, shift_output


def displacement(k: np.ndarray) -> np.ndarray:
    """A signal known between the samples as well, up to a third of the highest frequency that sampling holds."""
    return 20 * np.sin(0.03 * k) + 3 * np.cos(0.4 * k + 1) + 0.5 * np.sin(1.0 * k) - 96


def play(x: np.ndarray, width: float) -> np.ndarray:
    out, state = np.empty_like(x), x[0]
    for k, value in enumerate(x):
        state = max(value - width, min(value + width, state))
        out[k] = state
    return out


def hysteretic_residual(x: np.ndarray, y: np.ndarray) -> float:
    """RMS of a least-squares fit of plays and an offset, counted once the plays are wound up."""
    basis = np.column_stack([*(play(x, width) for width in (0.0, 0.2, 0.5)), np.ones_like(x)])[700:]
    weights = np.linalg.lstsq(basis, y[700:], rcond=None)[0]
    return float(np.sqrt(np.mean((basis @ weights - y[700:]) ** 2)))


def lagging_actuator(lag: float, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Drive and sensed output of a hysteretic actuator simulated 50 times finer than it is sampled."""
    fine = np.arange(-20 * 50, 4000 * 50) / 50
    drive = np.sin(0.01 * fine) * (1 - 0.3 * np.cos(0.0013 * fine))
    output = 3 * play(drive, 0.0) + 2 * play(drive, 0.2) + play(drive, 0.5) - 96
    at = np.arange(20 * 50, fine.size, 50)
    return drive[at], output[at - round(50 * lag)] + noise * np.random.default_rng(0).normal(size=at.size)


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


@pytest.mark.parametrize("lag", [0.5, -0.5, 40.5, -40.5])
def test_a_fraction_keeps_every_sample_that_has_its_neighbours(lag: float) -> None:
    values, kept = shift_output(np.arange(300.0), lag)
    first, last = np.arange(300)[kept][[0, -1]]
    reach = HALF_WIDTH + 0.5
    assert values.size == last - first + 1
    assert first == max(0, np.ceil(HALF_WIDTH - 1 - np.floor(lag)))
    assert last == min(299, np.floor(299 - HALF_WIDTH - np.floor(lag)))
    assert first + lag >= reach - 1
    assert last + lag <= 299 - reach + 1


@pytest.mark.parametrize("lag", [0.5, 2.3])
def test_an_offset_stays_and_a_ramp_stays_straight(lag: float) -> None:
    k = np.arange(200.0)
    np.testing.assert_allclose(shift_output(np.full(200, -96.0), lag).values, -96.0, rtol=1e-14)
    values, kept = shift_output(k, lag)
    np.testing.assert_allclose(values, k[kept] + lag, atol=1e-4)


def test_a_shift_by_half_a_sample_keeps_the_noise_so_that_it_does_not_look_like_a_better_fit() -> None:
    noise = np.random.default_rng(2).normal(size=50_000)
    assert np.var(shift_output(noise, 0.5).values) > 0.95 * np.var(noise)


def test_a_signal_is_not_written_to() -> None:
    y = np.arange(200.0)
    y.setflags(write=False)
    shift_output(y, 1)
    shift_output(y, 1.5)
    np.testing.assert_array_equal(y, np.arange(200.0))


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


def test_the_lowest_of_several_valleys_is_found() -> None:
    found = minimise_over_lag(lambda at: np.cos(2.2 * at) + 0.05 * (at - 7) ** 2, 12)
    assert found.samples == pytest.approx(7.11, abs=0.05)


def test_a_lag_beyond_the_largest_is_said_to_be_at_the_edge() -> None:
    found = minimise_over_lag(lambda at: -at, 3.5)
    assert (found.samples, found.at_edge) == (3.5, True)


def test_no_lag_is_asked_twice_for_its_error_and_none_beyond_the_limits() -> None:
    asked: list[float] = []
    minimise_over_lag(lambda at: asked.append(at) or (at - 2.3) ** 2, 6)
    assert len(asked) == len(set(asked)) < 25
    assert min(asked) == 0
    assert max(asked) == 6


def test_a_largest_lag_of_zero_asks_once() -> None:
    asked: list[float] = []
    minimise_over_lag(lambda at: asked.append(at) or 3.0, 0)
    assert asked == [0.0]


@pytest.mark.parametrize("max_lag", [-1, np.inf, np.nan])
def test_a_senseless_largest_lag_is_refused(max_lag: float) -> None:
    with pytest.raises(ValueError, match="max_lag must be a finite number of samples from 0 up"):
        minimise_over_lag(lambda at: at, max_lag)


def test_an_error_that_is_no_number_is_refused_with_its_lag() -> None:
    with pytest.raises(ValueError, match="not a number at a lag of 2 samples"):
        minimise_over_lag(lambda at: np.nan if at == 2 else at, 4)


@pytest.mark.parametrize("lag", [0.0, 0.5, 2.0, 3.3])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_lag_of_a_hysteretic_actuator_is_found(lag: float, noise: float) -> None:
    x, y = lagging_actuator(lag, noise)
    window = slice(HALF_WIDTH, y.size - HALF_WIDTH - 6)

    def residual(at: float) -> float:
        values, kept = shift_output(y, at)
        return hysteretic_residual(x[window], values[window.start - kept.start : window.stop - kept.start])

    assert minimise_over_lag(residual, 6).samples == pytest.approx(lag, abs=0.05 if noise == 0 else 0.2)
