"""What every solver of every lane refuses in one sentence, and what a refusal leaves: copies, answers before a solve,
and data and starting points that are none."""

import copy
import os
import pickle
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from programs import ALL, solver_class
from qpsolvers import Problem

import solvers
from solvers import Lane, Solver, Unsupported
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
    [
        pytest.param(e, id=f"{e.lane} {e.name}", marks=[pytest.mark.slow] * (e.name == "qpax"))  # JAX traces every call
        for e in entries()
    ],
)
P, LB = np.array([[3.0, 1.0, 0.5], [1.0, 2.0, 0.3], [0.5, 0.3, 1.0]]), np.zeros(3)
ANSWERS = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 1.0]])
Q = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]) - ANSWERS @ P
"""Linear costs of the two answers."""
FIELDS = {
    "P": {"P": P, "q": Q[0], "lb": LB},
    "G": {"P": P, "q": Q[0], "lb": LB, "G": np.ones((1, 3)), "h": np.full(1, 9.0)},
    "A": {"P": P, "q": Q[0], "lb": LB, "A": np.ones((1, 3)), "b": np.full(1, 3.0)},
    "ub": {"P": P, "q": Q[0], "lb": LB, "ub": np.full(3, 9.0)},
}
NONE = {"NaN": np.nan, "inf": np.inf, "-inf": -np.inf}
WRONG = {
    "P": (
        "P",
        ("NaN", "inf"),
        {
            "asymmetric": P + 1e-6 * np.eye(3, k=1),
            "of 2": np.eye(2),
            "complex": P + 1j,
            "inf twice": np.where(P == 0.3, np.inf, P),
        },
    ),
    "q": ("P", ("NaN", "-inf"), {"of 2": np.zeros(2), "of text": np.array(["a", "b", "c"])}),
    "G": ("G", ("NaN", "inf"), {"of 2 columns": np.ones((1, 2)), "of 2 rows": np.ones((2, 3)), "missing": None}),
    "h": ("G", ("NaN", "-inf"), {"of 2": np.ones(2)}),
    "A": ("A", ("NaN", "inf"), {"of 2 columns": np.ones((1, 2))}),
    "b": ("A", ("NaN", "inf"), {"of 2": np.ones(2), "missing": None}),
    "lb": ("ub", ("NaN", "inf"), {"above ub": np.full(3, 9.5), "of 2": np.zeros(2)}),
    "ub": ("ub", ("NaN", "-inf"), {"of 2": np.ones(2)}),
    "start": ("", ("NaN", "inf"), {"of 1": np.zeros(1), "of 4": np.zeros(4), "of 3, 3": P, "complex": LB + 1j}),
}
"""Of each part: the fields among which it is given, entries that it must not have, and whole arrays."""
FOLLOWS: dict[str, tuple[Callable[[Solver], Any], int]] = {
    "solution": (lambda s: s.solution().x, 0),
    "solve": (lambda s: s.solve(), 0),
    "loop": (lambda s: s.time_kernel(P[None], Q[1:])[2][0], 1),
    "update": (lambda s: (s.update(q=Q[1]), s.solve(), s.solution().x + (s.solution().problem.P != P).sum())[2], 1),
}
"""Calls after a refusal, with the number of their answer."""


@each_solver
def test_a_solver_refuses_copies_in_one_sentence_and_has_no_answer_before_a_solve_of_the_present_data(
    entry: Entry,
) -> None:
    run(keep_the_promises, entry)


@pytest.mark.filterwarnings("ignore::UserWarning")  # of qpsolvers and cvxpy, and true
@each_solver
def test_wrong_data_and_starts_are_refused_before_a_library_sees_them_and_leave_a_solver_as_it_was_or_not_ready(
    entry: Entry,
) -> None:
    run(refuse_what_is_wrong, entry)


def run(promises: Callable[[str, str], None], entry: Entry) -> None:
    solver_class(entry)
    if entry.name not in COMMERCIAL:
        promises(entry.name, entry.lane)
        return
    words = [sys.executable, "-c", f"import sys, test_every_solver as t; t.{promises.__name__}(*sys.argv[1:])"]
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
        x = solver.solve()
        np.testing.assert_allclose(x, [1.0, 0.0], atol=0.05)
        with suppress(ValueError):  # read-only
            x *= 3.0
        for array in (unsolved.problem.P, unsolved.problem.q, unsolved.problem.lb):
            array += 3.0
        solution = solver.solution()
        np.testing.assert_allclose(solution.x, [1.0, 0.0], atol=0.05)
        assert solution.found
        assert solution.primal_residual() + solution.dual_residual() + solution.duality_gap() < 0.3


def refuse_what_is_wrong(name: str, lane: str) -> None:
    solver, fresh, told = solvers.get(name, lane), solvers.get(name, lane), []
    for what, refused in wrong(Lane(lane)):
        told += [f"{what}: {fault}" for fault in faults(solver, refused, may_be_taken="indefinite" in what)]
        if "setup" in what and "indefinite" not in what:
            with pytest.raises((ValueError, Unsupported)):
                refused(fresh)
    for call, _ in FOLLOWS.values():
        with pytest.raises((ValueError, Unsupported), match=r"is not ready until the next good setup|compiled loop"):
            call(fresh)
    assert not told, "\n".join(told)


def wrong(lane: Lane) -> Iterator[tuple[str, Callable[[Solver], object]]]:
    """Calls that a solver refuses, by what is wrong; an indefinite P may pass."""
    for part, (among, entries_of_none, arrays) in WRONG.items():
        good = FIELDS[among][part] if among else LB
        for what in entries_of_none:
            arrays = {**arrays, what: np.where(np.arange(good.size).reshape(good.shape) == 0, NONE[what], good)}
        for what, array in arrays.items():
            label = f"{part} {what}"
            if among:
                given = Problem(**{**FIELDS[among], part: array})
                yield f"setup, {label}", lambda s, given=given: s.setup(given)
            else:
                yield f"solve, {label}", lambda s, array=array: s.solve(array)
            if part in "Pq":
                yield f"update, {label}", lambda s, part=part, array=array: s.update(**{part: array})
            if lane is Lane.KERNEL and (part in "Pq" or not among):
                a = {"P": P, "q": Q[1], "start": LB, part: array}
                yield f"loop, {label}", lambda s, a=a: s.time_kernel(a["P"][None], a["q"][None], a["start"])
    yield "update, indefinite P", lambda s: s.update(P=-P)
    yield "setup, indefinite P", lambda s: s.setup(Problem(-P, Q[0], lb=LB))


def faults(solver: Solver, refused: Callable[[Solver], object], may_be_taken: bool) -> Iterator[str]:
    """What is wrong about a refusal, and about each of the calls that may follow it."""
    is_ready, refusals = False, (Exception,) if may_be_taken else (ValueError, Unsupported)
    for name, (call, which) in FOLLOWS.items():
        if not is_ready:
            solver.setup(Problem(**FIELDS["P"]))
            solver.solve()
        try:
            refused(solver)
        except refusals as error:
            if "\n" in str(error):
                yield f"refused in two lines: {error}"
        else:
            if not may_be_taken:
                yield "taken"
            return
        try:
            x, is_ready = call(solver), True
        except (ValueError, Unsupported) as error:
            is_ready = isinstance(error, Unsupported)  # there is no loop
            if not is_ready and "is not ready until" not in str(error):
                yield f"then {name}: {error}"
        else:
            if x is not None and not np.allclose(x, ANSWERS[which], atol=0.05):
                yield f"then {name}: {x} for {ANSWERS[which]}"


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
