"""What the README tells a newcomer to type works as it stands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from piezo_model import plants
from piezo_model.recordings import write_table
from piezo_model.signals import decaying_triangle, multi_sine

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
SAMPLE_TIME = 1e-3


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """A folder with a recording of a simulated actuator and a reference, as the README assumes."""
    plant = plants.get("relay_preisach", sample_time=SAMPLE_TIME)
    x = multi_sine(duration_s=6.0, sample_time=SAMPLE_TIME, low=0.0, high=150.0, highest_Hz=10.0)
    y = plant.run(x)
    write_table(tmp_path / "stage.csv", {"time_s": np.arange(x.size) * SAMPLE_TIME, "voltage_V": x, "displacement_um": y})
    y_ref = decaying_triangle(duration_s=2.0, sample_time=SAMPLE_TIME, low=float(y.min()), high=float(y.max()))
    write_table(tmp_path / "reference.csv", {"time_s": np.arange(y_ref.size) * SAMPLE_TIME, "reference_um": y_ref})
    return tmp_path


def test_the_commands_for_a_recording_of_ones_own_make_a_model_and_a_drive(stage: Path) -> None:
    (block,) = [text for text in blocks("sh") if "identify" in text]
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    for command in block.strip().splitlines():
        done = subprocess.run(command.split(), cwd=stage, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert (stage / "model.json").is_file()
    assert (stage / "drive.csv").read_text().startswith("time_s,drive_V")


def test_the_python_example_runs(stage: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(stage)
    (block,) = blocks("python")
    names: dict[str, object] = {"y_ref": np.linspace(-10.0, 10.0, 100)}
    exec(compile(block, "README.md", "exec"), names)
    assert "Forward error" in capsys.readouterr().out
    assert np.all(np.isfinite(names["drive"]))


def test_every_verb_that_the_readme_shows_exists() -> None:
    done = subprocess.run([sys.executable, "-m", "bench", "--help"], capture_output=True, text=True, check=True)
    for verb in set(re.findall(r"^piezobench (\w+)", "\n".join(blocks("sh")), flags=re.MULTILINE)):
        assert re.search(rf"^\s+{verb}\s", done.stdout, flags=re.MULTILINE), verb


def test_every_make_target_that_the_readme_shows_exists() -> None:
    makefile = (Path(__file__).parent.parent / "Makefile").read_text()
    for target in set(re.findall(r"make ([a-z]+)", README)):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target
