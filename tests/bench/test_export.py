"""Problems as files: changes are detected, others can race on them, and qpbenchmark judges answers to them alike."""

import json
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import qpsolvers
from command_line import CommandLine, in_process
from program_files import DRAWN
from programs import library

from bench.problems import RaceProblem
from bench.races.metrics import _residuals

Arrays = dict[str, Any]


@pytest.fixture(scope="module")
def exported(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two dense problems and one sparse one with rows, each a set."""
    folder = tmp_path_factory.mktemp("exported")
    for words in (("--set", "noise", "--limit", 2), ("--set", "foreign", "--limit", 1, "--folder", DRAWN)):
        piezobench.run("problems", *words, "--export", folder)
    return folder


def changed(source: Path, target: Path, change: Callable[[Arrays, dict[str, Any]], None]) -> Path:
    """A copy of a saved problem with something changed in its arrays or in its certificate of the scaled form."""
    with np.load(source) as stored:
        arrays: Arrays = {name: stored[name] for name in stored.files}
    meta = json.loads(str(arrays["meta"]))
    certificate = json.loads(meta["certificates"]["scaled"])
    change(arrays, certificate)
    meta["certificates"]["scaled"] = json.dumps(certificate)
    arrays["meta"] = np.array(json.dumps(meta))
    np.savez(target, **arrays)
    return target


def perturb_optimum(arrays: Arrays, certificate: dict[str, Any]) -> None:
    certificate["x"][0] = float(np.nextafter(certificate["x"][0], np.inf))


def perturb_data(arrays: Arrays, certificate: dict[str, Any]) -> None:
    arrays["scaled/q"][3] *= 1.0 + 1e-15


CHANGES = {perturb_optimum: "line 7 (answer)", perturb_data: "line 1 (problem)"}  # test_certificate tries every line


def test_saved_problems_are_verified_as_they_are(exported: Path) -> None:
    call = in_process("problems", "--set", "foreign", "--folder", exported, "--verify")
    assert "3 of 3 problems are certified in every scaling (100 %): every proof holds." in call.stdout


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
@pytest.mark.parametrize("name", ["noise--noise-none", "foreign--drawn.mat"])
def test_a_saved_problem_in_which_anything_was_changed_is_not_raced(
    exported: Path, tmp_path: Path, name: str, change: Callable[..., None]
) -> None:
    changed(exported / f"{name}.npz", tmp_path / f"{name}.npz", change)
    call = in_process("problems", "--set", "foreign", "--folder", tmp_path, "--verify")
    assert "there is no certified problem" in call.refusal
    assert f"Not certified and therefore not raced: {name}: proof {CHANGES[change]}" in call.stdout


def test_a_proof_that_does_not_hold_is_named_and_the_listing_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        RaceProblem, "wrong_proofs", lambda problem: {"raw": "proof line 7"} if "afm" in problem.name else {}
    )
    said = r"not every proof holds: measured/afm_\w+ \(raw\): proof line 7"
    assert re.search(said, in_process("problems", "--set", "measured", "--verify").refusal)


@pytest.mark.parametrize(
    ("module", "count", "sparse"), [("piezobench_noise", 4, False), ("piezobench_foreign", 2, True)]
)
def test_qpbenchmark_finds_every_problem_in_each_scaling(
    exported: Path, module: str, count: int, sparse: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    load_test_set = library("qpbenchmark.benchmark").load_test_set

    monkeypatch.syspath_prepend(str(exported))
    test_set = load_test_set(str(exported / f"{module}.py"))
    problems = list(test_set)
    assert test_set.count_problems() == len(problems) == len({problem.name for problem in problems}) == count
    assert test_set.sparse_only is sparse
    assert set(test_set.tolerances) == set(test_set.solver_settings)
    for problem in problems:
        path, scaling = problem.name.rsplit("--", 1)
        ours = RaceProblem.load(exported / f"{path}.npz").forms[scaling]
        answer = qpsolvers.solve_problem(problem, solver="clarabel" if sparse else "daqp")
        assert (0.5 * answer.x @ (problem.P @ answer.x) + problem.q @ answer.x) == pytest.approx(
            ours.certificate.value_rounded, rel=1e-6
        )
        assert test_set.get_problem(problem.name).q.tobytes() == ours.qp.q.tobytes()


SOLVERS = ("osqp", "quadprog")
COLUMNS = ("primal_residual", "dual_residual", "duality_gap")


@pytest.mark.slow
def test_residuals_and_verdicts_on_an_exported_set_are_those_of_qpbenchmark(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    benchmark = library("qpbenchmark.benchmark")
    piezobench.run("problems", "--set", "measured", "--export", tmp_path)
    file = tmp_path / "piezobench_measured.py"
    command = next(line.split()[1:] for line in file.read_text().splitlines() if "run --author" in line)
    for solver in SOLVERS:
        subprocess.run([sys.executable, *command, "--solver", solver], cwd=tmp_path, check=True)
    assert file.with_suffix(".md").is_file()
    theirs = pd.read_csv(file.with_suffix(".csv")).set_index(["problem", "solver", "settings"])
    problems = [RaceProblem.load(path) for path in tmp_path.glob("*.npz")]
    test_set = benchmark.load_test_set(str(file))
    right = 0
    forms = {f"measured--{each.name}--{name}": form for each in problems for name, form in each.forms.items()}
    for (name, form), solver, settings in product(forms.items(), SOLVERS, ("low_accuracy", "high_accuracy")):
        with warnings.catch_warnings(action="ignore"):
            answer = qpsolvers.solve_problem(form.qp, solver, **test_set.solver_settings[settings][solver])
        row, case = theirs.loc[name, solver, settings], f"{solver}, {settings}, {name}"
        assert answer.found == row.found, case
        if answer.found:
            tolerance = test_set.tolerances[settings]
            limits = np.array([tolerance.primal, tolerance.dual, tolerance.gap])
            residuals, found = _residuals(answer), row[list(COLUMNS)].to_numpy(dtype=float)
            ours = np.array([residuals[column] for column in COLUMNS])
            np.testing.assert_array_equal(ours <= limits, found <= limits, err_msg=case)
            right += bool((ours <= limits).all())
            x = np.abs(answer.x)
            terms = np.abs(form.qp.P) @ x + np.abs(form.qp.q)
            np.testing.assert_allclose(ours, found, rtol=1e-6, atol=1e-14 * max(terms.max(), x @ terms))
    assert right > 12
