"""One model of several recordings of a stage, which was sampled slowly for its creep and fast for its resonance."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine

from piezo_model import (
    Dynamics,
    HysteresisCreepModel,
    IdentificationError,
    ModelStructure,
    OperatorState,
    Recording,
    identify,
)
from piezo_model.recordings import write_table
from piezo_model.units import UnitError

SLOW, FAST = 0.05, 5e-4
PERIODS = {"slow": SLOW, "fast": FAST}
STATIC = ModelStructure.equidistant(8, 1, (0.0, 100.0), (0.0, 50.0), 10.0 ** np.arange(2, -4, -1), FAST, offset=True)


STAGE = HysteresisCreepModel.from_weights(STATIC, [*[0.06] * 8, 0.05, 1.4, -0.04, 0.03, *[0.0] * 9])
"""With a creep of 2 % a decade, beside the resonance."""


def drive(kind: str, seed: int) -> np.ndarray:
    """Slow loops and a held step for eight minutes, or steps of 50 ms for three seconds."""
    generator = np.random.default_rng(seed)
    if kind == "fast":
        return np.repeat(np.r_[0.0, generator.uniform(0.0, 100.0, 59)], 100)
    t = np.arange(3200) * SLOW
    loops = 50.0 - 50.0 * np.cos(2.0 * np.pi * t / generator.uniform(25.0, 35.0)) * np.linspace(1.0, 0.2, t.size)
    return np.concatenate([loops, np.full(6400, generator.uniform(70.0, 95.0))])


def recorded(kind: str, seed: int = 0, noise: float = 3e-4) -> Recording:
    """A recording of the stage."""
    x = drive(kind, seed)
    y = STAGE.at(PERIODS[kind]).simulate(x, OperatorState.before_drive(STATIC))
    if kind == "fast":
        y = Dynamics((120.0,), (0.04,), (1.0,), 0.8 * FAST).filter(y, FAST, float(y[0]))
    y += noise * np.ptp(y) * np.random.default_rng(100 + seed).normal(size=y.size)
    return Recording.from_arrays(x, y, PERIODS[kind], input_unit="V", output_unit="um", name=kind)


@pytest.fixture(scope="module")
def recordings() -> list[Recording]:
    """One of each kind."""
    return [recorded(kind) for kind in PERIODS]


@pytest.fixture(scope="module")
def both(recordings: list[Recording]) -> HysteresisCreepModel:
    """The model of both."""
    return identify(recordings)


@pytest.mark.parametrize("kind", PERIODS)
def test_one_model_errs_no_more_on_another_drive_of_each_kind_than_a_model_of_that_recording(
    recordings: list[Recording], both: HysteresisCreepModel, kind: str
) -> None:
    alone, fresh = identify(recordings[kind == "fast"]), recorded(kind, seed=7, noise=0.0)
    errors = [model.at(PERIODS[kind]).validate(fresh).fit.rms_percent for model in (both, alone)]
    assert errors[0] < max(1.2 * errors[1], 0.03)


def test_a_model_of_both_has_the_creep_of_the_slow_one_and_the_resonance_of_the_fast_one(
    both: HysteresisCreepModel,
) -> None:
    creep = [model.figures()["creep_percent_per_decade"][0] for model in (both, STAGE)]
    assert creep[0] == pytest.approx(creep[1], rel=0.03)
    ((low_Hz, high_Hz),) = both.report["dynamics"]["intervals"]["frequencies_Hz"]
    assert low_Hz < 120.0 < high_Hz


def test_the_report_says_what_each_recording_determines(
    recordings: list[Recording], both: HysteresisCreepModel
) -> None:
    members = both.report["members"]
    assert [(member["name"], member["sample_time_s"]) for member in members] == list(PERIODS.items())
    assert all(member["rms_percent"] < 1.3 * member["alone_percent"] for member in members)
    assert both.structure.sample_time == FAST
    for one in recordings:
        assert "was fitted to this recording" in " ".join(both.validate(one).sentences())


def test_neither_the_level_of_the_sensor_nor_the_units_nor_the_order_change_the_model(
    recordings: list[Recording], both: HysteresisCreepModel
) -> None:
    slow, fast = recordings
    moved = dataclasses.replace(fast.in_units("mV", "nm"), y=1000.0 * fast.y + 9000.0)
    other, same = (model.figures() for model in (identify([moved, slow]), both))
    for name in ("gain", "hysteresis_percent", "creep_percent_per_decade"):
        assert other[name][0] == pytest.approx(same[name][0], rel=0.03)


@pytest.mark.parametrize("order", [1, -1])
def test_the_resonance_is_that_of_the_recording_that_shows_one_whatever_the_order_and_the_sampling_periods(
    order: int,
) -> None:
    x = 50.0 - 50.0 * np.cos(np.pi * FAST * np.arange(12_000))
    y = STAGE.at(0.5 * FAST).simulate(x, OperatorState.before_drive(STATIC))
    smooth = Recording.from_arrays(x, y, 0.5 * FAST, input_unit="V", output_unit="um", name="smooth")
    assert identify([smooth, recorded("fast")][::order]).dynamics.frequencies_Hz == pytest.approx((120.0,), rel=0.01)


def test_recordings_that_contradict_each_other_are_refused(recordings: list[Recording]) -> None:
    slow, fast = recordings
    for change, error, sentence in (
        ({"y": -fast.y, "y_range": (-fast.y_range[1], -fast.y_range[0])}, IdentificationError, "falls in fast"),
        ({"x": fast.x + 200.0, "x_range": (200.0, 300.0)}, IdentificationError, "slow and fast: .* no input in common"),
        ({"input_unit": "um"}, UnitError, "fast"),
    ):
        with pytest.raises(error, match=sentence):
            identify([slow, dataclasses.replace(fast, **change)])
    with pytest.raises(IdentificationError, match="several were given"):
        identify(recordings, state=OperatorState.before_drive(STATIC))


def test_the_command_line_makes_one_model_of_several_files(
    piezobench: CommandLine, recordings: list[Recording], tmp_path: Path
) -> None:
    files = [tmp_path / f"{one.name}.csv" for one in recordings]
    for file, one in zip(files, recordings, strict=True):
        write_table(file, {"time_s": np.arange(one.length) * one.sample_time, "drive_V": one.x, "output_um": one.y})
    call = piezobench.run("identify", *files, "--out", tmp_path / "model.json")
    assert all(f"{file}: RMS error" in call.stdout for file in files)
    model = HysteresisCreepModel.load(tmp_path / "model.json")
    assert model.structure.sample_time == FAST
    assert model.validate(Recording.open(files[1])).own
    call = piezobench("identify", *files, "--out", tmp_path / "other.json", "--page", tmp_path / "page.html")
    assert "--page: is for one recording" in call.refusal.replace("'", "")
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".csv", ".csv", ".json"]
