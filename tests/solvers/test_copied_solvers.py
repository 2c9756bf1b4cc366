"""Copies of solvers: they own memory of compiled code, and refuse."""

import copy
import pickle

import numpy as np
import pytest
from programs import solver_class
from qpsolvers import Problem

import solvers
from solvers import Lane
from solvers.registry import Entry, entries

PROBLEM = Problem(np.diag([1.0, 2.0]), np.array([-1.0, 2.0]), lb=np.zeros(2))
COPIES = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": pickle.dumps}


@pytest.mark.parametrize(
    "entry",
    [
        pytest.param(entry, id=f"{entry.lane} {entry.name}", marks=[pytest.mark.slow] * (entry.lane is Lane.CODEGEN))
        for entry in entries()
    ],
)
def test_a_solver_refuses_to_be_copied_in_one_sentence_and_still_solves(entry: Entry) -> None:
    solver = solver_class(entry)()
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
