"""Beside qpbenchmark on the same exported problems: the residuals and verdicts of its judge and of ours are the
same."""

import warnings
from itertools import product
from pathlib import Path

import numpy as np
import qpsolvers
from programs import library

from bench.problem_files.qpbenchmark_set import write_test_set
from bench.problems import make
from bench.races.metrics import _residuals

SOLVERS = ("clarabel", "cvxopt", "daqp", "osqp", "piqp", "proxqp", "quadprog", "scs")
SETTINGS = ("low_accuracy", "high_accuracy")
COLUMNS = ("primal_residual", "dual_residual", "duality_gap")


def test_residuals_and_verdicts_are_those_of_qpbenchmark(tmp_path: Path) -> None:
    benchmark = library("qpbenchmark.benchmark")
    from qpbenchmark.results import Results
    from qpbenchmark.run import run

    problems = list(make("measured").problems())
    for problem in problems:
        problem.save(tmp_path / f"measured--{problem.name}.npz")
    test_set = benchmark.load_test_set(str(write_test_set(tmp_path, "measured", sparse=False)))
    results = Results(tmp_path / "results.csv", test_set)
    solvers = [solver for solver in SOLVERS if solver in qpsolvers.available_solvers]
    with warnings.catch_warnings(action="ignore"):  # of solvers that do not reach what is asked for
        for solver in solvers:
            for settings in SETTINGS:
                run(test_set, results, only_solver=solver, only_settings=settings)
    theirs = results.df.set_index(["problem", "solver", "settings"])
    assert len(theirs) == len(solvers) * len(SETTINGS) * 2 * len(problems)
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
    assert right > 50
