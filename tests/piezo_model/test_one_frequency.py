"""Drives of one frequency and one amplitude, which determine no creep."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter, sawtooth

from piezo_model import HysteresisCreepModel, Recording, identify, signals
from piezo_model.identification.one_frequency import ONE_FREQUENCY, has_one_frequency
from piezo_model.operators import play

Vector = NDArray[np.float64]
SAMPLE_TIME = 0.01
SAMPLES = 6000


def triangle(cycles: Vector, rise: float = 0.5) -> Vector:
    """From 0 up to 1 and back in each cycle."""
    return np.asarray(0.5 + 0.5 * sawtooth(2 * np.pi * cycles, rise))


def sine(cycles: Vector) -> Vector:
    return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * cycles))


def time(rng: Generator, most: float = 40.0) -> Vector:
    """Time in cycles, from a random phase on."""
    return np.arange(SAMPLES) / SAMPLES * rng.uniform(2.0, most) + rng.uniform()


def inverse(y: Vector) -> Vector:
    """A drive that has loops of its own."""
    return y - 0.2 * play(y, [0.2], [0.0])[0][:, 0]


def trapezoid(rng: Generator, hold: float) -> Vector:
    """Rises, holds, falls and holds; the holds last ``hold`` times as long as the rises."""
    turn = 0.5 / (1 + hold)
    return np.interp(time(rng) % 1, [0, turn, 0.5, 0.5 + turn, 1], [0, 1, 1, 0, 0])


def two_speeds(rng: Generator) -> Vector:
    """The same triangle, at first slowly."""
    cycles, ratio = np.cumsum(np.ones(SAMPLES)) / SAMPLES * rng.uniform(20.0, 60.0), rng.uniform(3.0, 10.0)
    return triangle(np.minimum(cycles / ratio, cycles - cycles[-1] * 0.5 * (1 - 1 / ratio)))


ONE: dict[str, Callable[[Generator], Vector]] = {
    "a triangle": lambda rng: triangle(time(rng)),
    "a sine": lambda rng: sine(time(rng)),
    "a sawtooth": lambda rng: triangle(time(rng), rng.uniform(0.05, 0.95)),
    "one loop": lambda rng: sine(time(rng)[: int(rng.uniform(0.9, 1.4) * SAMPLES)] / 20),
    "a ramp": lambda rng: np.linspace(*rng.permutation([0.0, 1.0]), SAMPLES),
    "a rest first": lambda rng: np.concatenate([np.zeros(int(rng.integers(1, 900))), sine(np.arange(SAMPLES) / 500)]),
    "a way to the start": lambda rng: np.concatenate([np.linspace(-0.5, 0, 300), triangle(np.arange(SAMPLES) / 700)]),
    "a measured drive": lambda rng: sine(time(rng)) + rng.uniform(0, 0.005) * rng.standard_normal(SAMPLES),
    "few digits": lambda rng: np.round(sine(time(rng, 20.0)) * 100) / 100,
    "a drifting drive": lambda rng: triangle(time(rng)) + 0.05 * np.arange(SAMPLES) / SAMPLES,
    "the drive of a compensator": lambda rng: inverse(sine(time(rng))),
    "short holds": lambda rng: trapezoid(rng, 0.2),
}
OTHERS: dict[str, Callable[[Generator], Vector]] = {
    "long holds": lambda rng: trapezoid(rng, rng.uniform(1.0, 20.0)),
    "a hold at the end": lambda rng: np.pad(triangle(time(rng)), (0, int(rng.integers(SAMPLES // 3, SAMPLES))), "edge"),
    "a step": lambda rng: (np.arange(SAMPLES) > rng.uniform(0.1, 0.9) * SAMPLES).astype(np.float64),
    "a staircase": lambda rng: signals.staircase(
        duration_s=60.0, sample_time=SAMPLE_TIME, low=0.0, high=1.0, levels=int(rng.integers(4, 16))
    ),
    "a sweep": lambda rng: sine(3 * np.geomspace(1.0, rng.uniform(3.0, 20.0), SAMPLES)),
    "two speeds": two_speeds,
    "two tones": lambda rng: sine(np.arange(SAMPLES) / 500) + 0.5 * sine(np.arange(SAMPLES) / rng.uniform(60, 300)),
    "many tones": lambda rng: signals.multi_sine(
        duration_s=60.0, sample_time=SAMPLE_TIME, low=0.0, high=1.0, highest_Hz=rng.uniform(0.5, 5.0)
    ),
    "a decaying sine": lambda rng: (
        np.sin(np.arange(SAMPLES) / 60) * np.exp(-rng.uniform(0.4, 3) * np.linspace(0, 1, SAMPLES))
    ),
    "a random walk": lambda rng: np.cumsum(lfilter([0.05], [1.0, -0.95], rng.standard_normal(SAMPLES))),
}


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("kind", "one"), [*((kind, True) for kind in ONE), *((kind, False) for kind in OTHERS)])
def test_a_drive_of_one_frequency_is_told_from_others_in_any_unit(kind: str, one: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-100, 100) + rng.choice([-1.0, 1.0]) * 10 ** rng.uniform(-3, 3) * (ONE | OTHERS)[kind](rng)
    assert has_one_frequency(Recording.from_arrays(x, x, SAMPLE_TIME)) == one


def stage(u: Vector, creep: float = 0.0) -> Vector:
    """Micrometres for 1 to 9 V, settled at 1 V; ``creep`` is the share of a decade of time."""
    plays = play(u, [0.24, 0.8, 2.0], [1.0] * 3)[0]
    crept = [lfilter([0, a], [1, a - 1], u - 1.0) for a in -np.expm1(-SAMPLE_TIME * 10.0 ** np.arange(1, -3, -1))]
    return np.asarray(40 * (0.8 * u + plays @ [0.1, 0.08, 0.06] + creep * np.sum(crept, axis=0)))


def recorded(u: Vector, creep: float = 0.0) -> Recording:
    noise = np.random.default_rng(0).normal(0, 0.3, u.size)
    return Recording.from_arrays(u, stage(u, creep) + noise, SAMPLE_TIME, input_unit="V", output_unit="um")


FAST = 1 + 8 * triangle(np.arange(SAMPLES) / 200)
SLOW = 1 + 8 * triangle(np.arange(7500) / 5000)
HELD = np.concatenate([np.linspace(1, 6, 100), np.full(10_000, 6.0)])


def worst(model: HysteresisCreepModel, u: Vector) -> float:
    """Largest error after the first quarter, per cent of the range, on average as offset as the sensor."""
    error = (model.simulate(u) - stage(u))[u.size // 4 :]
    return 100 * float(np.ptp(error)) / 320.0


def test_a_model_of_one_frequency_has_no_creep_and_holds_at_other_speeds_and_on_a_held_step() -> None:
    model, without = identify(recorded(FAST)), identify(recorded(FAST), creep_rates=())
    assert model.structure.creep_rates == ()
    assert model.weights.tolist() == without.weights.tolist()
    assert worst(model, SLOW) < 0.4
    assert worst(model, HELD) < 1e-9
    assert ONE_FREQUENCY in model.report["findings"]
    assert ONE_FREQUENCY in without.report["findings"]
    assert {tuple(each["creep_rates"]) for each in model.report["selection"]["table"]} == {()}
    assert not any("Creep rates chosen" in sentence for sentence in model.report["sentences"])


def test_given_rates_are_used_and_orders_that_are_given_leave_creep_out_as_well() -> None:
    given = identify(recorded(FAST), n=5, m=3, creep_rates=(1.0,))
    assert given.structure.creep_rates == (1.0,)
    assert ONE_FREQUENCY not in given.report["sentences"]
    assert identify(recorded(FAST), n=3, m=1).structure.creep_rates == ()


def test_a_step_held_for_a_minute_determines_creep() -> None:
    model = identify(recorded(np.concatenate([FAST, HELD]), creep=0.02))
    assert model.structure.creep_rates
    assert ONE_FREQUENCY not in model.report["sentences"]
