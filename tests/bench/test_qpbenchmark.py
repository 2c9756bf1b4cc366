"""qpbenchmark on exported problems, by the command in the file: its residuals and verdicts equal ours."""

import subprocess
import sys
import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import qpsolvers
from command_line import CommandLine
from programs import library

from bench.problems import RaceProblem
from bench.races.metrics import _residuals

SOLVERS = ("clarabel", "osqp", "proxqp", "quadprog")
SETTINGS = ("low_accuracy", "high_accuracy")
COLUMNS = ("primal_residual", "dual_residual", "duality_gap")


def test_residuals_and_verdicts_on_an_exported_set_are_those_of_qpbenchmark(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    benchmark = library("qpbenchmark.benchmark")
    piezobench.run("problems", "--set", "measured", "--export", tmp_path)
    file = tmp_path / "piezobench_measured.py"
    command = next(line.split()[1:] for line in file.read_text().splitlines() if "run --author" in line)
    solvers = [solver for solver in SOLVERS if solver in qpsolvers.available_solvers]
    for solver in solvers:
        words = [sys.executable, *command, "--solver", solver]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert file.with_suffix(".md").is_file()
    theirs = pd.read_csv(file.with_suffix(".csv")).set_index(["problem", "solver", "settings"])
    problems = [RaceProblem.load(path) for path in tmp_path.glob("*.npz")]
    test_set = benchmark.load_test_set(str(file))
    right = 0
    forms = {f"measured--{each.name}--{name}": form for each in problems for name, form in each.forms.items()}
    for (name, form), solver, settings in product(forms.items(), solvers, SETTINGS):
        with warnings.catch_warnings(action="ignore"):
            answer = qpsolvers.solve_problem(form.qp, solver, **test_set.solver_settings[settings][solver])
        row, case = theirs.loc[name, solver, settings], f"{solver}, {settings}, {name}"
        assert answer.found == row.found, case
        if answer.found:
            tolerance = test_set.tolerances[settings]
            limits = np.array([tolerance.primal, tolerance.dual, tolerance.gap])
            ours, found = np.array(_residuals(answer)), row[list(COLUMNS)].to_numpy(dtype=float)
            np.testing.assert_array_equal(ours <= limits, found <= limits, err_msg=case)
            right += bool((ours <= limits).all())
            if solver != "proxqp":  # which is not repeatable to the last bit
                x = np.abs(answer.x)
                terms = np.abs(form.qp.P) @ x + np.abs(form.qp.q)
                np.testing.assert_allclose(ours, found, rtol=1e-6, atol=1e-14 * max(terms.max(), x @ terms))
    assert right > 25
