from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from ringing_stage import T, recorded, steps

from piezo_model import Dynamics, IdentificationError, Recording, identify, plants, signals
from piezo_model.identification.dynamics import GAIN
from piezo_model.identification.resonance import Spectra

SIZE = 40_000
PLANTS = ("maxwell_slip", "relay_preisach", "bouc_wen", "duhem", "dense_prandtl_ishlinskii")
MODE = [(500.0, 0.01, 1.0)]
DELAY_S = 1.3125 * T


def triangle(size: int, seed: int) -> np.ndarray:
    duration = size * T
    return signals.decaying_triangle(
        duration_s=duration, sample_time=T, low=0.0, high=150.0, cycles=10.0 * duration, final_share=0.05
    )


def tones(size: int, seed: int) -> np.ndarray:
    t, rng = np.arange(size) * T, np.random.default_rng(seed)
    sines = (np.sin(2 * np.pi * f * t + rng.uniform(0.0, 6.28)) / np.sqrt(f) for f in (1, 2, 5, 10, 20, 50, 100, 200))
    total = sum(sines)
    return 75.0 + 75.0 * total / np.abs(total).max()


def sweep(size: int, seed: int) -> np.ndarray:
    t = np.arange(size) * T
    rate = np.log(500.0) / t[-1]
    f = np.exp(rate * t)
    return 75.0 - 75.0 / np.maximum(1.0, f / 50.0) * np.cos(2 * np.pi * (f - 1.0) / rate)


def binary_on_levels(size: int, seed: int) -> np.ndarray:
    bits = np.random.default_rng(seed).choice([-1.0, 1.0], size // 20 + 1)
    return np.clip(0.9 * steps(size, seed, 0.25) + 7.5 + 3.75 * np.repeat(bits, 20)[:size], 0.0, 150.0)


DRIVES: dict[str, Callable[[int, int], np.ndarray]] = {
    "triangle": triangle,
    "tones": tones,
    "sweep": sweep,
    "binary": binary_on_levels,
    "steps": steps,
}


def made(
    kind: str, drive: str, modes: list[tuple[float, float, float]], noise_um: float = 0.02, seed: int = 31
) -> Recording:
    x = DRIVES[drive](SIZE, seed)
    return Recording.from_arrays(x, recorded(kind, x, modes, DELAY_S, noise_um, seed + 1), T)


@pytest.mark.sample(2)
@pytest.mark.parametrize("drive", ["steps", "binary", "sweep"])
@pytest.mark.parametrize("kind", PLANTS[:2])
def test_a_resonance_is_in_the_model_and_predicts_steps_that_it_has_not_seen(kind: str, drive: str) -> None:
    model = identify(made(kind, drive, MODE))
    assert model.dynamics is not None
    assert model.dynamics.frequencies_Hz[0] == pytest.approx(500.0, rel=2e-3)
    assert model.dynamics.damping[0] == pytest.approx(0.01, rel=0.1)
    assert model.dynamics.delay_s == pytest.approx(DELAY_S, abs=0.2 * T)
    x = steps(20_000, 77)
    later = Recording.from_arrays(x, recorded(kind, x, MODE, DELAY_S), T)
    assert model.validate(later).fit.rms_percent < 1.0
    assert any("A resonance at 500" in sentence for sentence in model.report["sentences"])
    assert "behind the inverse of the dynamics" in model.report["selection"]["sentence"]
    low, high = model.report["dynamics"]["intervals"]["frequencies_Hz"][0]
    assert low < 500.0 < high


def test_steps_determine_frequency_damping_and_delay() -> None:
    g = identify(made("maxwell_slip", "steps", MODE)).dynamics
    assert g is not None
    assert g.frequencies_Hz[0] == pytest.approx(500.0, rel=1e-3)
    assert g.damping[0] == pytest.approx(0.01, rel=0.03)
    assert g.delay_s == pytest.approx(DELAY_S, abs=0.05 * T)


@pytest.mark.sample(1)
@pytest.mark.parametrize("modes", [[(300.0, 0.01, 0.8), (900.0, 0.02, 0.15)], [(120.0, 0.05, 0.9)]])
def test_a_second_mode_or_residual_compliance_is_found(modes: list[tuple[float, float, float]]) -> None:
    g = identify(made("relay_preisach", "steps", modes)).dynamics
    assert g is not None
    for found, (f, zeta, gain) in zip(zip(g.frequencies_Hz, g.damping, g.gains, strict=True), modes, strict=True):
        assert found == pytest.approx((f, zeta, gain), rel=0.05)


def test_two_modes_without_residual_compliance_are_found() -> None:
    modes = [(300.0, 0.01, 0.8), (900.0, 0.02, 0.2)]
    g = identify(made("maxwell_slip", "steps", modes)).dynamics
    assert g is not None
    assert g.frequencies_Hz == pytest.approx((300.0, 900.0), rel=2e-3)
    assert g.damping == pytest.approx((0.01, 0.02), rel=0.1)
    assert g.gains == pytest.approx((0.8, 0.2), rel=0.05)
    assert g.delay_s == pytest.approx(DELAY_S, abs=0.1 * T)


@pytest.mark.sample(6)
@pytest.mark.parametrize("noise_um", [0.002, 0.02, 0.2])
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("kind", PLANTS)
def test_no_resonance_is_found_where_there_is_none(kind: str, drive: str, noise_um: float) -> None:
    model = identify(made(kind, drive, [], noise_um), n=5, m=3, force=True)
    assert model.dynamics is None
    assert not any("resonance" in sentence for sentence in model.report["sentences"])


def test_where_one_mode_gains_nothing_over_none_no_richer_dynamics_are_tried() -> None:
    period, x = 1e-3, steps(40_000, 4, 0.02, 1e-3)
    y = plants.get("bouc_wen", sample_time=period).run(x) + np.random.default_rng(4).normal(0.0, 0.02, x.size)
    recording = Recording.from_arrays(x, y, period)
    assert Spectra(recording).peak().gain > GAIN  # the scan alone would take it for a mode
    model, ignored = (identify(recording, n=5, m=3, dynamics=choice) for choice in ("estimate", "ignore"))
    assert model.dynamics is None
    assert model.report["dynamics"] is None
    assert model.report["passes"] < 4 * ignored.report["passes"]


def test_a_faint_resonance_is_named_with_what_to_record() -> None:
    recording = made("relay_preisach", "triangle", [(400.0, 0.24, 1.0)], 0.05)
    model = identify(recording, force=True)
    assert model.dynamics is None
    assert any("record steps of 20 ms to determine it" in sentence for sentence in model.report["findings"])


def test_known_dynamics_stay_as_they_are_and_impossible_ones_are_refused() -> None:
    recording, known = made("maxwell_slip", "steps", MODE), Dynamics((501.0,), (0.011,), (1.0,), 1.3 * T)
    model = identify(recording, n=5, m=3, dynamics=known)
    assert model.dynamics == known
    assert model.report["lag"] is None
    with pytest.raises(IdentificationError, match="the resonance at 5000 Hz is above 35 % of the sampling rate"):
        identify(recording, dynamics=Dynamics((5000.0,), (0.01,), (1.0,), 0.0))
    with pytest.raises(IdentificationError, match="dynamics must be one of estimate, ignore, not 'guess'"):
        identify(recording, dynamics="guess")  # type: ignore[arg-type]


def test_a_recording_in_parts_rings_from_the_balance_of_each() -> None:
    one, other = (made("maxwell_slip", "steps", MODE, seed=seed) for seed in (5, 6))
    joined = Recording.from_arrays(np.r_[one.x, other.x], np.r_[one.y, other.y], T)
    model = identify(replace(joined, starts=(0, SIZE)), n=5, m=3)
    assert model.dynamics is not None
    assert model.dynamics.frequencies_Hz[0] == pytest.approx(500.0, rel=1e-3)
