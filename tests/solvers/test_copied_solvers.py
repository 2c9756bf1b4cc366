"""Copies of solvers: they own memory of compiled code, and refuse."""

import copy
import os
import pickle
import subprocess
import sys

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


@pytest.mark.parametrize(
    "entry",
    [
        pytest.param(entry, id=f"{entry.lane} {entry.name}", marks=[pytest.mark.slow] * (entry.lane is Lane.CODEGEN))
        for entry in entries()
    ],
)
def test_a_solver_refuses_to_be_copied_in_one_sentence_and_still_solves(entry: Entry) -> None:
    solver_class(entry)  # skips where it is not installed
    if entry.name not in COMMERCIAL:
        refuse_copies(entry.name, entry.lane)
        return
    words = [sys.executable, "-c", "import sys, test_copied_solvers as t; t.refuse_copies(*sys.argv[1:])"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([*words, entry.name, entry.lane], env=paths, check=True, timeout=120)


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
