"""What every solver of every lane refuses in one sentence: copies, and answers before a solve."""

import copy
import os
import pickle
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from programs import solver_class
from qpsolvers import Problem

import solvers
from solvers import Lane
from solvers.registry import Entry, entries

PROBLEM = Problem(np.diag([1.0, 2.0]), np.array([-1.0, 2.0]), lb=np.zeros(2))
COMMERCIAL = ("copt", "gurobi", "xpress")
"""Libraries that end a process in which others of them have solved before: an illegal instruction."""
COPIES = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": pickle.dumps}
each_solver = pytest.mark.parametrize(
    "entry",
    [
        pytest.param(entry, id=f"{entry.lane} {entry.name}", marks=[pytest.mark.slow] * (entry.lane is Lane.CODEGEN))
        for entry in entries()
    ],
)


def check(promise: Callable[[str, str], None], entry: Entry) -> None:
    """Test a promise of a solver; skips where it is not installed."""
    solver_class(entry)
    if entry.name not in COMMERCIAL:
        promise(entry.name, entry.lane)
        return
    words = [sys.executable, "-c", f"import sys, test_every_solver as t; t.{promise.__name__}(*sys.argv[1:])"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([*words, entry.name, entry.lane], env=paths, check=True, timeout=120)


@each_solver
def test_a_solver_refuses_to_be_copied_in_one_sentence_and_still_solves(entry: Entry) -> None:
    check(refuse_copies, entry)


@each_solver
def test_a_solver_has_no_answer_before_a_solve_of_the_present_data(entry: Entry) -> None:
    check(find_nothing_unsolved, entry)


def find_nothing_unsolved(name: str, lane: str) -> None:
    solver = solvers.find(name, Lane(lane)).load()()
    with pytest.raises(ValueError, match=r"setup") as refused:
        solver.solution()
    assert "\n" not in str(refused.value)
    solver.setup(PROBLEM)
    for _ in range(2):
        unsolved = solver.solution()
        assert (unsolved.found, unsolved.x, unsolved.extras) == (False, None, {"status": "not solved yet"})
        assert solver.iterate() is None
        solver.solve()
        assert solver.solution().found
        solver.update(q=PROBLEM.q)


def refuse_copies(name: str, lane: str) -> None:
    solver = solvers.find(name, Lane(lane)).load()()
    for ready in (False, True):
        if ready:
            solver.setup(PROBLEM)
        for way in COPIES.values():
            with pytest.raises(TypeError, match="cannot be copied or pickled; set up another one") as refused:
                way(solver)
            assert "\n" not in str(refused.value)
    np.testing.assert_allclose(solver.solve(), [1.0, 0.0], atol=0.05)


def test_the_sentence_names_a_remedy_that_works() -> None:
    solver = solvers.get("box_active_set", most_exchanges=5)
    with pytest.raises(TypeError, match=r"solvers\.get\('box_active_set', \*\*settings\) and setup\(problem\)"):
        copy.copy(solver)
    other = solvers.get("box_active_set", **solver.settings)
    other.setup(PROBLEM)
    assert other.solve().tolist() == [1.0, 0.0]
