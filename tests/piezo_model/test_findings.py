"""Sentences about an identification have the digits that make a difference."""

import pytest

from piezo_model.identification.dynamics_finding import DynamicsFinding


@pytest.mark.parametrize(
    ("interval", "amplifier_lag_s", "which", "words"),
    [
        ((119.99, 120.01), 0.0, 0, "at 120 Hz (119.99 to 120.01 Hz) with"),
        ((119.9999, 120.0001), 0.0, 0, "at 120 Hz with"),
        ((119.0, 121.0), 2e-4, -1, "interval, and the amplifier lags by 200 µs; the RMS error"),
        ((119.0, 121.0), 0.0, -1, "by 1 ms (0 s to 2 ms) from the end of the sampling interval; the RMS error"),
    ],
    ids=["enough digits", "no interval", "an amplifier's lag beside the delay", "no lag"],
)
def test_the_interval_of_a_frequency_has_enough_digits_or_is_left_out_and_the_lag_of_an_amplifier_is_said(
    interval: tuple[float, float], amplifier_lag_s: float, which: int, words: str
) -> None:
    kept = DynamicsFinding(
        True,
        (120.0,),
        (0.02,),
        1e-3,
        amplifier_lag_s,
        {"frequencies_Hz": [[*interval]], "damping": [[0.01, 0.03]], "delay_s": [[0.0, 2e-3]]},
        (9.0, 0.3),
        "",
        0.5,
        ((interval[0], interval[0]),),
        (0.0, 0.0),
    )
    assert words in [*kept.sentences()][which]
