"""The library without the extra ``bench``: a recording in, model and drive out."""

import subprocess
import sys
from importlib.metadata import requires

import pytest
from packaging.requirements import Requirement

REFUSE = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {absent!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Refuse())
"""
IDENTIFY = """
import numpy as np
from piezo_model import Compensator, Recording, identify, plants
from piezo_model.recordings import write_table
rng = np.random.default_rng(0)
plant = plants.get("dense_prandtl_ishlinskii", sample_time=1e-3)
low, high = plant.x_range
x = low + (high - low) * (0.5 + 0.5 * np.sin(2 * np.pi * np.arange(6000) / 1500) * np.linspace(1.0, 0.3, 6000))
write_table(sys.argv[1], {"time_s": np.arange(x.size) * 1e-3, "voltage_V": x, "displacement_um": plant.run(x)})
model = identify(Recording.open(sys.argv[1]), n=3, m=1)
y_ref = np.linspace(*np.quantile(plant.run(x), (0.3, 0.7)), 100)
assert np.isfinite(Compensator(model, x_limits=plant.x_range).run(y_ref)).all()
print(model.report["headline"])
"""
MODULES = {"vl-convert-python": "vl_convert"}


def absent() -> set[str]:
    """Modules of the packages that only the extra ``bench`` requires."""
    needed = [Requirement(text) for text in requires("piezobench") or []]
    base = {requirement.name for requirement in needed if requirement.marker is None}
    extra = {
        requirement.name
        for requirement in needed
        if requirement.marker is not None and requirement.marker.evaluate({"extra": "bench"})
    }
    return {MODULES.get(name, name) for name in extra - base}


@pytest.mark.parametrize("name", ["stage.csv", "stage.parquet"])
def test_a_recording_is_identified_and_compensated_without_the_packages_of_the_command(tmp_path, name) -> None:
    assert {"pandas", "typer"} <= absent()
    script = tmp_path / "alone.py"
    script.write_text(REFUSE.format(absent=absent()) + IDENTIFY)
    done = subprocess.run([sys.executable, script, tmp_path / name], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert "with this model" in done.stdout


def test_the_command_says_what_to_install_if_its_packages_are_absent() -> None:
    done = subprocess.run(
        [sys.executable, "-c", REFUSE.format(absent={"typer"}) + "from bench.cli import main; main()"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (
        2,
        "piezobench: the command needs the package typer: install piezobench[bench]\n",
    )
