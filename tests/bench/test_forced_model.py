"""A forced model: everything made from it carries the warning."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from command_line import CommandLine

from piezo_model.recordings import read_reference, write_table

SAMPLE_TIME = 1e-3
WARNING = "The model was forced although the output is noise that does not follow the drive"


@pytest.fixture(scope="module")
def desk(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, chance, k = tmp_path_factory.mktemp("desk"), np.random.default_rng(0), np.arange(4000)
    write_table(
        folder / "noise.csv",
        {"time_s": k * SAMPLE_TIME, "voltage_V": np.sin(k / 100), "displacement_um": chance.standard_normal(k.size)},
    )
    write_table(folder / "wish.csv", {"time_s": k[:500] * SAMPLE_TIME, "reference_um": 0.1 * np.sin(k[:500] / 100)})
    words = ("identify", "noise.csv", "--out", "model.json", "--n", 2, "--m", 1)
    refusal = piezobench(*words, folder=folder).refusal
    assert "noise.csv: the output is noise that does not follow the drive" in refusal
    assert not (folder / "model.json").exists()
    call = piezobench.run(*words, "--force", folder=folder)
    assert WARNING in " ".join(call.stdout.split())
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
        first, header = out.read_text().splitlines()[:2]
        assert first.startswith(f"# {WARNING}")
        assert header.startswith("time_s,drive_V")
    else:
        assert WARNING in pq.read_schema(out).metadata[b"remark"].decode()
    drive = read_reference(out, column="drive_V", role="input")
    assert (drive.sample_time, drive.values.size) == (SAMPLE_TIME, 500 if verb == "compensate" else 4000)
