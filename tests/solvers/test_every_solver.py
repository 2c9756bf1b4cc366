"""What every solver of every lane refuses in one sentence: copies, and answers before a solve."""

import copy
import os
import pickle
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from programs import ALL, solver_class
from qpsolvers import Problem

import solvers
from solvers import Lane
from solvers.registry import Entry, available, entries

OURS = "accelerated_projection box_active_set projected_difference"
DEFAULT_RACE = {
    "kernel": f"{OURS} daqp quadprog",
    "direct": f"{OURS} clarabel cvxopt daqp highspy osqp piqp proxsuite pyqpmad qoco qpalm quadprog scipy_bvls "
    "scipy_lbfgsb scipy_nnls scs",
    "qpsolvers": "clarabel cvxopt daqp ecos highs osqp piqp proxqp pyqpmad qpalm quadprog scs",
    "cvxpy": "clarabel cvxopt daqp ecos highs osqp piqp proxqp qoco qpalm scs",
}
"""Solvers by lane that race on what `make bench` installs."""
NEEDS_A_SYSTEM_LIBRARY = {"proxsuite", "proxqp"}
PROBLEM = Problem(np.diag([1.0, 2.0]), np.array([-1.0, 2.0]), lb=np.zeros(2))
COMMERCIAL = ("copt", "gurobi", "xpress")
"""Libraries that end a process in which others of them have solved before: an illegal instruction."""
COPIES: dict[str, Callable[[object], object]] = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": pickle.dumps}
each_solver = pytest.mark.parametrize(
    "entry",
    [pytest.param(entry, id=f"{entry.lane} {entry.name}") for entry in entries()],
)


@each_solver
def test_a_solver_refuses_copies_in_one_sentence_and_has_no_answer_before_a_solve_of_the_present_data(
    entry: Entry,
) -> None:
    solver_class(entry)
    if entry.name not in COMMERCIAL:
        keep_the_promises(entry.name, entry.lane)
        return
    words = [sys.executable, "-c", "import sys, test_every_solver as t; t.keep_the_promises(*sys.argv[1:])"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([*words, entry.name, entry.lane], env=paths, check=True, timeout=120)


def keep_the_promises(name: str, lane: str) -> None:
    solver = solvers.find(name, Lane(lane)).load()()
    refuse_copies(solver)
    with pytest.raises(ValueError, match=r"setup") as refused:
        solver.solution()
    assert "\n" not in str(refused.value)
    solver.setup(PROBLEM)
    refuse_copies(solver)
    for change in ({}, {"q": PROBLEM.q}, {"P": PROBLEM.P, "q": PROBLEM.q}):
        solver.update(**change)
        unsolved = solver.solution()
        assert (unsolved.found, unsolved.x, unsolved.extras) == (False, None, {"status": "not solved yet"})
        np.testing.assert_allclose(solver.solve(), [1.0, 0.0], atol=0.05)
        assert solver.solution().found


def refuse_copies(solver: solvers.Solver) -> None:
    for way in COPIES.values():
        with pytest.raises(TypeError, match="cannot be copied or pickled; set up another one") as refused:
            way(solver)
        assert "\n" not in str(refused.value)


def test_the_sentence_names_a_remedy_that_works() -> None:
    solver = solvers.get("box_active_set", most_exchanges=5)
    with pytest.raises(TypeError, match=r"solvers\.get\('box_active_set', \*\*settings\) and setup\(problem\)"):
        copy.copy(solver)
    other = solvers.get("box_active_set", **solver.settings)
    other.setup(PROBLEM)
    assert other.solve().tolist() == [1.0, 0.0]


def test_the_default_race_is_of_these_21_solvers_in_46_lanes() -> None:
    extras = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    of_make = [*extras["dependencies"], *extras["optional-dependencies"]["field"]]
    of_make += ["piezobench", *extras["optional-dependencies"]["copyleft"]]
    installed = {re.match(r"[\w-]+", words)[0] for words in of_make}
    race = {(entry.lane, entry.name) for entry in available() if entry.load().distribution in installed}
    named = {(Lane(lane), name) for lane, names in DEFAULT_RACE.items() for name in names.split()}
    assert (len({name for _, name in named}), len(named)) == (21, 46)
    assert race <= named
    assert {name for _, name in named - race} <= (set() if ALL else NEEDS_A_SYSTEM_LIBRARY)
