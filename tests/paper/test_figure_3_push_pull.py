"""Fig. 3: an axis of the positioning system is driven by one actuator, which needs S, or by two in push-pull, which do
not."""

import re
from pathlib import Path

import pytest
from example_scripts import run_example
from programs import library

pd = library("pandas")


@pytest.mark.slow
def test_one_curved_actuator_needs_s_and_two_in_push_pull_do_not(tmp_path: Path) -> None:
    output = run_example("experiment/push_pull.py", "--quick", "--seed", 1, "--out", tmp_path)
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
