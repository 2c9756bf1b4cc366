"""Fig. 2: the trajectory of (7) meets the boundary of the admissible set, slides along it, and ends at the optimum.
Fig. 3: an axis of the positioning system is driven by one actuator, which needs S, or by two in push-pull, which do
not."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import run_example
from programs import library

pd = library("pandas")
import boundary  # noqa: E402


def test_the_trajectory_meets_the_boundary_slides_along_it_and_never_leaves_the_set(tmp_path: Path) -> None:
    run_example("paper/boundary.py", "--quick", "--seed", 1, "--out", tmp_path)
    t = pd.read_csv(tmp_path / "figures" / "fig2_boundary.csv").set_index("name")
    path, unprojected = t.loc["path"].set_index("step"), t.loc["unprojected"].set_index("step")
    first = int(np.argmax(path.held <= 0.0))
    assert path.held[0] > 0.0, "it begins inside; the bound is at 0"
    assert (path.held >= 0.0).all()
    assert (path.held[first:] == 0.0).all()
    assert (unprojected.held[first:] < 0.0).all()
    assert np.ptp(path.free[first:]) > 0.0


def test_the_trajectory_ends_at_the_optimum_of_the_whole_problem() -> None:
    part = boundary.Slice(
        ("a", "b"), np.array([[1.0, 0.6], [0.6, 1.0]]), np.array([0.5, -1.0]), np.zeros(2), np.array([0.0, 1.0])
    )
    path, free = boundary.trajectory(part, np.array([1.0, 3.0]), steps=2000)
    np.testing.assert_allclose(path[-1], part.optimum, atol=1e-9)
    np.testing.assert_allclose(path[1:], np.maximum(free[:-1], 0.0), atol=1e-12)


@pytest.mark.slow
def test_one_curved_actuator_needs_s_and_two_in_push_pull_do_not(tmp_path: Path) -> None:
    output = run_example("paper/push_pull.py", "--quick", "--seed", 1, "--out", tmp_path)
    t = pd.read_csv(tmp_path / "figures" / "push_pull.csv").set_index(["kind", "n", "push_pull", "m"]).rms_percent
    assert t["curved", 10, False, 0] > 5.0 * t["curved", 10, False, 3]
    assert t["curved", 10, True, 0] <= 1.1 * t["curved", 10, True, 3]
    ratio = re.search(
        r"Curved actuators, n = 10: with one actuator .* is ([\d.]+) times .* without S is as good as "
        r"with it",
        output,
    )
    assert ratio is not None
    assert float(ratio[1]) == pytest.approx(t["curved", 10, False, 0] / t["curved", 10, False, 3], abs=0.06)
