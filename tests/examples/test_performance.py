"""The benchmarks of the kernels and of a bank run, each as a developer starts it."""

import pytest
from bank import by_count
from example_scripts import run_example


@pytest.mark.slow
def test_the_kernels_are_timed_beside_a_numpy_version_with_the_same_result() -> None:
    said = run_example("performance/kernels.py", 1)
    assert len(said.partition("data basis, d = 18, 3 creep rates, a sample")[2].splitlines()[0].split()) == 3, (
        "ours, NumPy's and the ratio"
    )
    assert "whole loop, box_active_set, continuous: learn" in said


def test_a_bank_is_stepped_in_real_time_beside_a_null_step() -> None:
    said = run_example("performance/bank.py", 9, 500, 0.1, 2)
    assert said.partition("a bank of 9, 2 threads")[2].split()[1:3] == ["–", "–"], "50 steps support a median alone"
    assert "a null step as long, the machine's floor" in said
    assert "Period 2000 µs, 10 exact optima a second of each" in said


def test_the_cost_of_a_bank_is_shown_by_its_size(capsys: pytest.CaptureFixture[str]) -> None:
    by_count((8,))
    assert capsys.readouterr().out.splitlines()[-1].split()[0] == "8"
