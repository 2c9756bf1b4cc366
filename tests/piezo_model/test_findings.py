"""Sentences about an identification have the digits that make a difference."""

from piezo_model.identification.dynamics_finding import DynamicsFinding


def resonance(low: float, high: float, amplifier_lag_s: float = 0.0) -> list[str]:
    """Sentences about a mode whose frequency has this interval."""
    kept = DynamicsFinding(
        True,
        (0.5 * (low + high),),
        (0.02,),
        1e-3,
        amplifier_lag_s,
        {"frequencies_Hz": [[low, high]], "damping": [[0.01, 0.03]], "delay_s": [[0.0, 2e-3]]},
        (9.0, 0.3),
        "",
        0.5,
        ((low, low),),
        (0.0, 0.0),
    )
    return [*kept.sentences()]


def test_the_interval_of_a_frequency_has_enough_digits_or_is_left_out() -> None:
    assert "at 120 Hz (119.99 to 120.01 Hz) with" in resonance(119.99, 120.01)[0]
    assert "at 120 Hz with" in resonance(119.9999, 120.0001)[0]


def test_the_lag_of_an_amplifier_is_said_beside_the_delay() -> None:
    assert "interval, and the amplifier lags by 200 µs; the RMS error" in resonance(119.0, 121.0, 2e-4)[-1]
    assert "interval; the RMS error" in resonance(119.0, 121.0)[-1]
