"""Faults of the bench are called by their names, and what resembles them is not."""

from collections.abc import Callable
from itertools import accumulate

import numpy as np
import pytest
from numpy.random import Generator
from recording_kinds import SAMPLE_TIME, Vector, creeping, drive, loops, noisy, resonant

from piezo_model import IdentificationError, Recording, identify
from piezo_model.identification.faults import Signals, faults_of, lost_rows, unexplained
from piezo_model.operators import play

K = np.arange(6000)


def slewing(u: Vector, rate: float) -> Vector:
    """The drive behind an amplifier that changes by at most a rate in a sample."""
    return np.array([*accumulate(u, lambda x, target: x + np.clip(target - x, -rate, rate))])


RESTING: dict[str, Callable[[Generator], Vector]] = {
    "steps": lambda rng: np.repeat(rng.uniform(-1.0, 1.0, 30), 200),
    "stairs": lambda _: np.repeat(1.0 - np.abs(np.linspace(-2.0, 2.0, 25)), 240),
    "a sine and holds": lambda _: np.sin(0.016 * np.minimum(K, 4000)) * (1.0 - 2.0 * (K > 5300)),
    "a triangle and a rest": lambda _: np.maximum(1.0 - np.abs(K - 900) / 400.0, -1.0),
    "a step at the end": lambda rng: np.append(np.repeat([*rng.uniform(-1.0, 0.4, 29), 0.5], 200)[:-1], 1.0),
}
"""Drives that rest on levels."""
FAULTS: dict[str, Callable[[Generator, Vector, Vector], Vector]] = {
    "repeats exactly in": lambda rng, _, y: y[np.maximum.accumulate(np.where(rng.uniform(size=K.size) < 0.1, 0, K))],
    "changes every 5 samples": lambda _, u, y: y[K // 5 * 5],
    "has spikes in 3 samples": lambda _, u, y: y + 0.5 * (K % 1500 == 1499) * (K < 5000),
    "while the drive still rises": lambda _, u, y: np.minimum(y, np.quantile(y, 0.85)),
    "while the drive still falls": lambda rng, u, y: noisy(rng, loops(rng, np.maximum(u, np.quantile(u, 0.15))), 1e-3),
    "lost rows": lambda _, u, y: np.concatenate([y[:2500], y[2520:], np.full(20, y[-1])]),
    "the clock jitters": lambda rng, _, y: np.interp(K + 0.3 * rng.normal(size=K.size), K, y),
    "limits the slew rate": lambda rng, u, _: noisy(rng, loops(rng, slewing(u, 0.02)), 1e-3),
}
LIMITS: dict[str, Callable[[Generator, Vector], Vector]] = {
    "amplifier": lambda rng, u: loops(rng, np.minimum(u, 0.4)),
    "sensor": lambda rng, u: np.minimum(creeping(rng, u), 0.4),
    "sensor of a stage that rings": lambda rng, u: np.minimum(resonant(loops(rng, u), 80.0, 0.05), 0.4),
}
CONTROLS: dict[str, Callable[[Vector], Vector]] = {
    "saturation": lambda u: np.tanh(2.5 * u),
    "backlash": lambda u: play(u, np.array([0.3]), u[:1])[0][:, 0],
    "a coarse quantiser": lambda u: 0.03 * np.round(u / 0.03),
    "a held drive": lambda u: u[K // 7 * 7],
    "ringing": lambda u: resonant(u, 100.0, 0.05),
    "ringing that the model leaves": lambda u: resonant(u, 330.0, 0.01),
    "jumps that the model leaves": lambda u: (
        np.append(0.0, np.random.default_rng(1).exponential(size=300)).cumsum()[
            np.searchsorted(np.sort(np.random.default_rng(2).uniform(-1.0, 1.0, 300)), u)
        ]
        / 150.0
        - 1.0
    ),
    "backlash and a lag on equal steps": lambda u: play(resonant(u, 20.0, 0.9), np.array([0.1]), u[:1])[0][:, 0],
    "wide loops": lambda u: loops(np.random.default_rng(3), u, 0.5),
    "a delay": lambda u: np.append(u[:2], u[:-2]),
    "a line": lambda u: 0.7 * u + 0.1,
}


def signals(u: Vector, y: Vector, model: Vector) -> Signals:
    return Signals.of(Recording.from_arrays(u, y, SAMPLE_TIME, output_unit="um"), model, 0, float(np.ptp(y)))


@pytest.mark.sample(8)
@pytest.mark.parametrize("form", [1, 3, 4])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_alone(fault: str, form: int) -> None:
    rng = np.random.default_rng(form)
    u = RESTING["steps"](rng) if "slew" in fault else drive(rng, K.size, form)
    clean = loops(rng, u, 0.2)
    found = faults_of(signals(u, FAULTS[fault](rng, u, noisy(rng, clean, 5e-4)), clean))
    assert [fault in sentence for sentence in found] == [True]


@pytest.mark.sample(12)
@pytest.mark.parametrize("resting", ["steps", "stairs"])
@pytest.mark.parametrize("limited", LIMITS)
@pytest.mark.parametrize("seed", range(10))
def test_a_limit_is_named_where_the_drive_rests_on_levels(seed: int, limited: str, resting: str) -> None:
    rng = np.random.default_rng(seed)
    u = RESTING[resting](rng)
    found = faults_of(signals(u, noisy(rng, LIMITS[limited](rng, u), 1e-3), u))
    assert ["while the drive still rises by" in sentence for sentence in found] == [True]


@pytest.mark.parametrize("noise", [0.0, 2e-3])
@pytest.mark.parametrize("form", [2, 4, *RESTING])
@pytest.mark.parametrize("control", CONTROLS)
def test_what_resembles_a_fault_is_not_named(control: str, form: int | str, noise: float) -> None:
    rng = np.random.default_rng(6)
    u = RESTING[form](rng) if isinstance(form, str) else drive(rng, K.size, form)
    clean, held = CONTROLS[control](u), u[K // 7 * 7] if "held" in control else u
    measured = noisy(rng, clean, noise)
    assert faults_of(signals(held, measured, u if "leaves" in control else clean)) == []
    assert lost_rows(signals(held, measured, 0.0 * u)) is None, "whatever the model leaves"


def test_an_error_that_no_fault_explains_has_a_sentence_without_a_name() -> None:
    u = drive(np.random.default_rng(0), K.size, 1)
    left = signals(u, u + 0.1 * np.sin(9.0 * u), u)
    assert faults_of(left) == []
    assert "none of the known faults" in str(unexplained(left))


def test_the_rounding_of_an_output_with_few_values_is_its_noise() -> None:
    u = drive(np.random.default_rng(0), K.size, 1)
    assert unexplained(signals(u, np.round(10.0 * u) / 10.0, u)) is None


def test_outputs_that_are_missing_while_the_stage_moves_leave_no_error() -> None:
    rng = np.random.default_rng(0)
    u = np.repeat(rng.integers(0, 9, 100) / 9.0, 20)
    y = noisy(rng, u, 1e-3)
    y[200:500] = np.nan
    model = identify(Recording.from_arrays(u, y, SAMPLE_TIME), n=1, m=0)
    assert not any("none of the known faults" in finding for finding in model.report["findings"])


@pytest.mark.parametrize("factor", [1.0, 1.0 + 1e-14])
def test_a_fault_is_a_finding_of_a_model_and_part_of_a_refusal(factor: float) -> None:
    rng = np.random.default_rng(2)
    u = drive(rng, 3000, 1)
    y = factor * np.minimum(loops(rng, u, 0.2), 0.3)
    assert "at its limit" in identify(Recording.from_arrays(u, y, SAMPLE_TIME), n=3, m=1).report["findings"][0]
    with pytest.raises(IdentificationError, match=r"RMS residual .*\. The output stops abruptly at .* its limit$"):
        identify(Recording.from_arrays(u, np.minimum(2.0 * u - loops(rng, u, 0.9), 0.5), SAMPLE_TIME))
