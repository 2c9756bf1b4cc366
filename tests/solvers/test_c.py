"""The box solver in C without Python: its own test, and the example, built by one command of a C compiler."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from programs import program
from qpsolvers import Problem

import solvers

ROOT = Path(__file__).parents[2]
CORE = ROOT / "solvers" / "core"


def output_of(source: Path, folder: Path, *options: str) -> str:
    """What a program of this source and the box solver prints; it must end with 0."""
    words = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", *options, f"-I{CORE}"]
    files = [str(file) for file in (source, *sorted(CORE.glob("box_*.c")))]
    subprocess.run([program("cc"), *words, *files, "-lm", "-o", str(folder / "built")], check=True)
    done = subprocess.run([folder / "built"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.mark.parametrize("options", [(), ("-DCORE_PLAIN",)], ids=" ".join)
def test_the_box_solver_passes_its_test_in_C_with_vectors_and_without(options: tuple[str, ...], tmp_path: Path) -> None:
    assert output_of(CORE / "test" / "test_box.c", tmp_path, *options) == ""


@pytest.mark.parametrize("options", [(), ("-DCORE_VARIABLES=3",)], ids=" ".join)
def test_the_example_in_C_prints_the_answer_of_the_solver_in_Python(options: tuple[str, ...], tmp_path: Path) -> None:
    P, q = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 1.0], [0.0, 1.0, 3.0]]), np.array([-2.0, -3.0, 2.0])
    solver = solvers.get("box_active_set")
    solver.setup(Problem(P, q, lb=np.zeros(3), ub=np.array([np.inf, 1.0, np.inf])))
    x = solver.solve()
    expected = "".join(
        f"x{j} = {value:.6f}, gradient {g:.6f}\n" for j, (value, g) in enumerate(zip(x, P @ x + q, strict=True))
    )
    assert output_of(ROOT / "examples" / "c" / "box_problem.c", tmp_path, *options) == expected
