"""``piezobench excite``: a drive from which everything can be determined, and its refusals."""

from pathlib import Path

import numpy as np
import pytest

from bench.cli.app import run
from piezo_model import Recording, identify, plants
from piezo_model.recordings import read_reference, write_table


def test_the_drive_stays_in_its_range_and_has_its_rate_its_holds_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, page = tmp_path / "drive.csv", tmp_path / "drive.html"
    assert run(["excite", "--range", "-20:100", "--rate", "500", "--out", str(out), "--page", str(page)]) == 0
    read = read_reference(out, role="input")
    assert (read.sample_time, read.values.size, read.unit) == (2e-3, 30_000, "V")
    assert read.values.min() == read.values[0] == read.values[-1] == -20.0
    assert 99.0 < read.values.max() <= 100.0
    edges = np.flatnonzero(np.diff(read.values, prepend=np.nan, append=np.nan) != 0.0)
    longest = np.sort(np.diff(edges))[-2:] * read.sample_time
    assert longest == pytest.approx(10.0, abs=0.1)
    assert "two holds of 10 s for creep" in capsys.readouterr().out
    assert "<svg" in page.read_text() or "vega" in page.read_text()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--range", "0-100", "--rate", "500"), "'0-100' is not two numbers, such as 0:100"),
        (("--range", "9:1", "--rate", "500"), "in ascending order, not"),
        (("--range", "0:1", "--rate", "10"), "gives 600 samples, and an excitation needs 2000"),
        (("--range", "0:1", "--rate", "0"), "must be positive, not 0"),
    ],
)
def test_an_impossible_drive_is_refused_and_nothing_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], sentence: str
) -> None:
    assert run(["excite", *words, "--out", str(tmp_path / "drive.csv")]) == 2
    assert sentence in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("plant", plants.names())
def test_hysteresis_and_creep_of_every_plant_are_found_from_its_recording(tmp_path: Path, plant: str) -> None:
    drive = tmp_path / "drive.csv"
    assert run(["excite", "--range", "0:100", "--rate", "200", "--out", str(drive)]) == 0
    x, period = read_reference(drive, role="input").values, 5e-3
    y = plants.get(plant, x_range=(0.0, 100.0), sample_time=period).run(x)
    y += np.random.default_rng(0).normal(0.0, 1e-3 * np.ptp(y), y.size)
    write_table(tmp_path / "stage.csv", {"time_s": np.arange(x.size) * period, "drive_V": x, "position_um": y})
    model = identify(Recording.open(tmp_path / "stage.csv"))
    assert model.report["hysteresis"]
    assert model.structure.creep_rates
    assert model.report["fit"]["rms_percent"] < 1.0
    assert not model.report["excitation"]["undetermined"]
    drive = model.report["drive"]
    assert drive["hysteresis"]
    assert drive["creep"]
    assert drive["drift"]
    assert drive["highest_Hz"] > 0.95 * 10.0  # a twentieth of the rate is announced
    assert drive["sentence"] in model.report["sentences"]
