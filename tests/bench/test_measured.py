"""The set of measured actuators: its files, and the proofs of its programs."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from make_measured import PROGRAMS
from make_measured import make as made_from

from bench.problems import RaceProblem, make
from bench.problems.measured import FOLDER, read
from bench.races.oneshot.passes import OneshotSettings
from piezo_model import DataBasis, plants
from piezo_model.recordings import write_table
from piezo_model.signals import SIGNALS
from solvers.certificate import verify


@pytest.fixture(scope="module")
def by_seed() -> list[dict[str, RaceProblem]]:
    return [{problem.name: problem for problem in make("measured", seed).problems()} for seed in range(PROGRAMS + 1)]


def test_measured_actuators_are_raced_by_default_and_have_sources_and_licences() -> None:
    assert OneshotSettings().problem_sets == ("paper", "measured")
    files = list(FOLDER.glob("*.npz"))
    assert len(files) == len(make("measured").names()) >= 3
    assert all(path.stat().st_size < 30_000 for path in files)
    readme = (FOLDER / "README.md").read_text()
    for path in files:
        line = next(line for line in readme.splitlines() if f"`{path.name}`" in line)
        licence = FOLDER / line.split("[")[1].split("]")[0]
        assert "MIT License" in licence.read_text()


def test_every_proof_holds_and_other_seeds_use_other_samples(
    by_seed: list[dict[str, RaceProblem]],
) -> None:
    first = by_seed[0]
    for problem in first.values():
        for form in problem.forms.values():
            verify(form.qp, form.certificate)
            assert form.optimum_is_unique
    for name in first:
        programs = [problems[name].forms["raw"].qp.P.tobytes() for problems in by_seed]
        assert len(set(programs)) == PROGRAMS
        assert programs[PROGRAMS] == programs[0]


def test_the_model_of_an_optimum_follows_the_samples_after_it_and_the_noise_is_below_its_error(
    by_seed: list[dict[str, RaceProblem]],
) -> None:
    for problem in by_seed[0].values():
        v = problem.validation
        assert v is not None
        error_um = v.error_percent(problem.optimal_weights) / 100.0 * v.span_um
        assert 0.0 < v.noise_um < 2.0 * error_um
        assert error_um < 0.02 * 2.0 * abs(v.structure.y_scale)


def test_a_file_made_from_a_recording_holds_the_sums_over_its_samples(tmp_path: Path) -> None:
    sample_time = 1e-3
    plant = plants.get("relay_preisach", sample_time=sample_time)
    x = SIGNALS["multi_sine"](duration_s=3.5, sample_time=sample_time, low=0.0, high=150.0, seed=3)
    y = plant.run(x) + 7.0
    write_table(
        tmp_path / "stage.csv", {"time_s": np.arange(x.size) * sample_time, "voltage_V": x, "displacement_um": y}
    )
    made_from("stage", tmp_path / "stage.csv", tmp_path)
    found = [read(tmp_path / "stage.npz", seed) for seed in range(PROGRAMS)]
    unseen = found[0][1]
    fitted = 2800
    np.testing.assert_allclose(unseen.x, x[fitted:], rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(unseen.y, y[fitted:], rtol=1e-6, atol=1e-5)
    # Together the programs of the longest window count every sample once.
    P, q, c = (np.mean([getattr(programs[-1], name) for programs, _ in found], axis=0) for name in "Pqc")
    reference = DataBasis(unseen.structure)
    reference.update(x[:fitted], y[:fitted])
    # of y alone, whatever the states were
    settled = np.arange(unseen.structure.n, unseen.structure.n + unseen.structure.dead_zones)
    np.testing.assert_allclose(
        P[np.ix_(settled, settled)], reference.P[np.ix_(settled, settled)], rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(q[settled], reference.q[settled], rtol=1e-9, atol=1e-12)
    assert c == pytest.approx(reference.c)


def test_make_bench_races_on_the_given_recording() -> None:
    folder = Path(__file__).parents[2]

    def recipe(*words: str) -> str:
        return subprocess.run(
            ["make", "-n", "--no-print-directory", "bench", *words],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    assert recipe().strip().endswith("piezobench race")
    assert '--recording "my stage.csv" --input voltage_V' in recipe(
        "RECORDING=my stage.csv", "OPTIONS=--input voltage_V"
    )
