"""From the file of an instrument to the code of a controller, by the command line alone; everything made from a forced
model carries the warning."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from command_line import CommandLine, contents
from programs import library

from piezo_model import plants
from piezo_model.recordings import read_reference, write_table

SAMPLE_TIME = 1e-3


@pytest.mark.needs("cc")
def test_a_falling_output_gives_the_controllers_of_the_negated_data(piezobench: CommandLine, tmp_path: Path) -> None:
    fmpy = library("fmpy")
    t = np.arange(8000) * SAMPLE_TIME
    x = 75.0 + 70.0 * np.sin(2 * np.pi * 0.7 * t) * (0.4 + 0.6 * t / t[-1])
    y = plants.get("relay_preisach", sample_time=SAMPLE_TIME).run(x)
    reference = y.mean() + 0.3 * np.ptp(y) * np.sin(2 * np.pi * 1.3 * t[:2000])
    drives = {}
    for name, sign in (("rising", 1.0), ("falling", -1.0)):
        folder = tmp_path / name
        folder.mkdir()
        write_table(folder / "stage.csv", {"time_s": t, "drive_V": x, "position_um": sign * y})
        write_table(folder / "wish.csv", {"time_s": t[:2000], "reference_um": sign * reference})
        for words in (
            ("identify", "stage.csv", "--out", "model.json"),
            ("compensate", "model.json", "wish.csv", "--start", "rest", "--out", "drive.csv"),
            ("export-fmu", "model.json", "it.fmu"),
        ):
            piezobench.run(*words, folder=folder)
        assert (
            "falls as the input rises" in json.dumps(json.loads((folder / "model.json").read_text())["report"])
        ) == (sign < 0.0)
        signals = np.rec.fromarrays([t[:2000], sign * reference], names="time,reference")
        found = fmpy.simulate_fmu(
            str(folder / "it.fmu"),
            stop_time=2000 * SAMPLE_TIME,
            step_size=SAMPLE_TIME,
            output_interval=SAMPLE_TIME,
            input=signals,
            output=["drive"],
            fmi_type="CoSimulation",
        )["drive"][1:]
        compensated = np.loadtxt(folder / "drive.csv", delimiter=",", skiprows=1)[:, 1]
        np.testing.assert_allclose(found, compensated, rtol=0, atol=1e-9)
        drives[name] = found, compensated
    assert np.ptp(drives["rising"][0]) > 20.0
    for rising, falling in zip(drives["rising"], drives["falling"], strict=True):
        np.testing.assert_array_equal(falling, rising)


WARNING = "The model was forced although the model class does not describe these data"


@pytest.fixture(scope="module")
def desk(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, chance, k = tmp_path_factory.mktemp("desk"), np.random.default_rng(0), np.arange(4000)
    write_table(
        folder / "noise.csv",
        {"time_s": k * SAMPLE_TIME, "voltage_V": np.sin(k / 100), "displacement_um": chance.standard_normal(k.size)},
    )
    write_table(folder / "wish.csv", {"time_s": k[:500] * SAMPLE_TIME, "reference_um": 0.1 * np.sin(k[:500] / 100)})
    words = ("identify", "noise.csv", "--out", "model.json", "--n", 2, "--m", 1)
    before = contents(folder)
    assert "noise.csv: the model class does not describe these data" in piezobench(*words, folder=folder).refusal
    assert contents(folder) == before
    assert WARNING in " ".join(piezobench.run(*words, "--force", folder=folder).stdout.split())
    return folder


@pytest.mark.needs("cc")
def test_exported_sources_their_description_an_fmu_and_the_table_of_a_fleet_carry_the_warning(
    piezobench: CommandLine, desk: Path, tmp_path: Path
) -> None:
    call = piezobench.run("export-c", desk / "model.json", tmp_path / "c")
    piezobench.run("export-fmu", desk / "model.json", tmp_path / "it.fmu")
    piezobench.run("identify", desk / "noise.csv", "--out-dir", tmp_path / "fleet", "--force", "--n", 1, "--m", 0)
    with zipfile.ZipFile(tmp_path / "it.fmu") as archive:
        description = archive.read("modelDescription.xml").decode()
    sources = [(tmp_path / "c" / name).read_text() for name in ("README.md", "piezo_parameters.h")]
    (forced,) = pd.read_csv(tmp_path / "fleet" / "fleet.csv").forced
    for text in (call.stderr.replace("\n", " "), *sources, description, forced):
        assert WARNING in text


@pytest.mark.parametrize(
    "words",
    [
        ("compensate", "model.json", "wish.csv", "--out", "drive.csv"),
        ("simulate", "model.json", "noise.csv", "--out", "output.csv"),
        ("validate", "model.json", "noise.csv"),
    ],
)
def test_results_of_a_forced_model_are_printed_with_the_warning(
    piezobench: CommandLine, desk: Path, words: tuple[str, ...]
) -> None:
    assert WARNING in piezobench(*words, folder=desk).stdout
    found = json.loads(piezobench(*words, "--json", folder=desk).stdout)
    assert WARNING in (found["sentences"][0] if words[0] == "validate" else found["forced"])


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("verb", ["compensate", "simulate"])
def test_a_table_made_from_a_forced_model_is_marked_and_read_all_the_same(
    piezobench: CommandLine, desk: Path, tmp_path: Path, verb: str, suffix: str
) -> None:
    out, given = tmp_path / f"made{suffix}", {"compensate": "wish.csv", "simulate": "noise.csv"}[verb]
    piezobench.run(verb, desk / "model.json", desk / given, "--out", out)
    if suffix == ".csv":
        assert re.match(f"# {WARNING}.*\ntime_s,drive_V", out.read_text())
    else:
        assert WARNING in pq.read_schema(out).metadata[b"remark"].decode()
    drive = read_reference(out, column="drive_V", role="input")
    assert (drive.sample_time, drive.values.size) == (SAMPLE_TIME, 500 if verb == "compensate" else 4000)
