"""Fig. 4: a staircase without compensation and with self-learning compensation, on a simulated stage; and what the
solver has to do with it."""

from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest
from command_line import run_example
from programs import library

pd = library("pandas")
import learning_accuracy  # noqa: E402
import two_axis_stage as stage  # noqa: E402

FIGURES = ("fig4_staircase_x", "fig4_staircase_y", "loops", "cycles")


Figures = namedtuple("Figures", "folder said")


def table(figures: Figures, name: str):
    return pd.read_csv(figures.folder / "figures" / f"{name}.csv")


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> Figures:
    """The experiment in its quick form."""
    folder = tmp_path_factory.mktemp("experiment") / "figures"
    return Figures(
        folder, run_example("paper/staircase.py", "--quick", "--seed", 1, "--solver", "box_active_set", "--out", folder)
    )


@pytest.mark.parametrize("axis", ["x", "y"])
def test_learning_follows_the_staircase_far_better_than_any_straight_line(figures: Figures, axis: str) -> None:
    t = table(figures, f"fig4_staircase_{axis}")
    rms = np.sqrt(t.assign(square=t.error_um**2).groupby("name").square.mean())
    assert t[t.name == "reference"].position_um.max() == pytest.approx(stage.AMPLITUDE_UM)
    assert rms["self-learning"] < 0.1 * rms["best straight line with hindsight"]
    assert rms["self-learning"] < 0.1 * rms["straight line"]


def test_the_line_of_hindsight_is_the_best_of_its_neighbours() -> None:
    setup = stage.Setup(**{**stage.QUICK, "cycles": 2})
    slope, offset_V = stage.lines(setup)
    best = stage.best_straight(setup).rms[-1]
    for shift in (0.97, 1.0, 1.03):
        assert (best <= stage.straight(setup, shift * slope, offset_V).rms[-1] * 1.02).all()


def test_the_error_falls_with_the_cycles_and_drift_calls_for_learning_on(figures: Figures) -> None:
    t = table(figures, "cycles").set_index(["stage", "name"]).percent.sort_index(kind="stable")
    learned = t["steady", "self-learning"]
    assert learned.iloc[-1] < 0.1 * learned.iloc[0]
    assert t["drifting", "self-learning"].iloc[-1] < t["drifting", "learned for 2 cycles, then fixed"].iloc[-1]


def test_loops_close_under_compensation(figures: Figures) -> None:
    largest = table(figures, "loops").groupby(["axis", "name"]).error_um.agg(lambda error: error.abs().max())
    for axis in stage.AXES:
        assert largest[axis, "self-learning"] < 0.4 * largest[axis, "straight line"]


def test_every_figure_exists_as_svg_and_numbers_and_the_verdict_is_said_and_in_the_report(figures: Figures) -> None:
    report = f"{FIGURES[0]}."
    assert sorted(str(path.relative_to(figures.folder)) for path in figures.folder.rglob("*.*")) == sorted(
        [f"{report}html", f"{report}md", *(f"{name}.svg" for name in FIGURES), *(f"figures/{n}.csv" for n in FIGURES)]
    )
    page, verdict = (figures.folder / f"{report}md").read_text(encoding="utf-8"), figures.said.splitlines()[0]
    assert verdict.startswith("Self-learning compensation brings the stage from")
    assert verdict in page
    for name in FIGURES:
        assert f"({name}.svg)" in page
        assert "<svg" in (figures.folder / f"{name}.svg").read_text(encoding="utf-8")


def test_the_decoupling_is_found_from_recordings_of_the_hysteretic_stage() -> None:
    np.testing.assert_allclose(stage.Setup().decoupling @ stage.COUPLING, np.eye(2), atol=1e-4)


def test_an_axis_in_push_pull_is_at_rest_and_point_symmetric_unlike_one_actuator() -> None:
    curved = "dense_prandtl_ishlinskii", {"saturation": 0.0, "asymmetry": -0.1, "creep_share": 0.0}
    single, pair = (stage.Setup(push_pull=pushes, sample_time=4e-4).axis(*curved) for pushes in (False, True))
    assert np.ptp(pair.run(np.zeros(3000))) < 1e-6
    swing = 75.0 - 75.0 * np.cos(2.0 * np.pi * np.arange(4000) / 1000)

    of_single, of_pair = (
        np.abs(p + np.roll(p, 500)).max() / np.ptp(p) for p in (axis.run(swing)[-1000:] for axis in (single, pair))
    )
    assert of_single > 0.05
    assert of_pair < 1e-3


@pytest.mark.slow
def test_the_learners_differ_by_their_accuracy_alone_and_too_few_steps_cost_tracking(tmp_path: Path) -> None:
    choice = ("--solvers", "box_active_set,daqp,scipy_nnls")
    said = run_example("paper/learning_accuracy.py", "--quick", "--seed", 1, *choice, "--out", tmp_path)
    t = pd.read_csv(tmp_path / "figures" / "learning_accuracy.csv").set_index(["solver", "setting"])
    exact, paper = t.loc[[("box_active_set", "default"), ("daqp", "tightest")]], t.loc[learning_accuracy.PAPERS]
    assert (exact.cost_gap < 1e-9).all()
    assert np.ptp(exact.rms_percent) < 1e-6
    assert paper.cost_gap.is_monotonic_decreasing
    assert paper.rms_percent["steps 1000"] > 1.2 * exact.rms_percent.max()
    assert paper.rms_percent["steps 1"] > 5.0 * paper.rms_percent["steps 1000"]
    assert "scipy_nnls, tightest: cost gap nan" in said, "a solver that fails leaves the stage on its straight line"
    assert "scipy_nnls" not in t.index
