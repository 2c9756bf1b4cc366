"""The contract of a solver: one table of cases for all solvers of the registry, and what ours promise beyond it."""

import copy
import pickle
import re
import sys
import tomllib
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from box_programs import INF, random_program, set_up
from command_line import python
from programs import ALL, COMMERCIAL, solver_class

import solvers
from solvers import Entry, Lane, Problem, Solver, Unsupported, arrays, available, checks, entries, registry, rows

OURS = "accelerated_projection box_active_set projected_difference"
DEFAULT_RACE = {
    "kernel": f"{OURS} daqp quadprog",
    "direct": f"{OURS} clarabel cvxopt daqp highspy osqp piqp proxsuite pyqpmad qoco qpalm quadprog scipy_bvls "
    "scipy_lbfgsb scipy_nnls scs",
    "qpsolvers": "clarabel cvxopt daqp ecos highs osqp piqp proxqp pyqpmad qpalm quadprog scs",
    "cvxpy": "clarabel cvxopt daqp ecos highs osqp piqp proxqp qoco qpalm scs",
}
"""Solvers by lane that race on what `make bench` installs."""
PROBLEM = Problem(np.diag([1.0, 2.0]), np.array([-1.0, 2.0]), lb=np.zeros(2))
COMPILED = (*OURS.split(), "daqp", "quadprog")
"""Solvers that release the interpreter's lock while they work on a large program."""
COPIES: dict[str, Callable[[object], object]] = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": pickle.dumps}
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
    "A": ("A", ("NaN", "inf"), {"of 2 columns": np.ones((1, 2)), "of 2 rows": np.ones((2, 3)), "missing": None}),
    "b": ("A", ("NaN", "inf"), {"of 2": np.ones(2), "missing": None}),
    "lb": ("ub", ("NaN", "inf"), {"above ub": np.full(3, 9.5), "of 2": np.zeros(2), "complex": LB + 1j}),
    "ub": ("ub", ("NaN", "-inf"), {"of 2": np.ones(2)}),
    "start": ("", ("NaN", "inf"), {"of 1": np.zeros(1), "of 4": np.zeros(4), "of 3, 3": P, "complex": LB + 1j}),
}
"""Of each part: the fields among which it is given, entries that it must not have, and whole arrays."""
FOLLOWS: dict[str, tuple[Callable[[Solver], Any], int]] = {
    "solution": (lambda s: np.where(s.solution().found, s.solution().x, np.nan), 0),
    "solve": (lambda s: s.solve(), 0),
    "loop": (lambda s: s.time_kernel(P[None], Q[1:])[2][0], 1),
    "update": (lambda s: (s.update(q=Q[1]), s.solve(), s.solution().x + (s.solution().problem.P != P).sum())[2], 1),
}
"""Calls after a refusal, with the number of their answer."""
SENTENCES = {
    r"NaN|inf": r"must be finite",
    r" of \d": r"expected shape",
    r"complex|text": r"must hold real numbers, not (complex128|<U1)",
    r"asymmetric": r"P is not symmetric$",
    r"above ub": r"a lower bound lies above its upper bound",
    r"missing": r"only one of",
    r"no variables": r"a problem without variables",
}
"""What a refusal says, by the words of its case."""
OF_OURS = {
    r"indefinite": r"P is indefinite beyond rounding",
    r"general row": r"takes bounds only, and .* has general rows",
}


def keep_the_promises(name: str, lane: str) -> None:
    solver = solvers.get(name, lane, **solvers.get(name, lane).settings)  # as the sentence of a refused copy says
    refuse_copies(solver)
    with pytest.raises(ValueError, match=r"\A.*setup.*\Z"):
        solver.solution()
    solver.setup(PROBLEM)
    refuse_copies(solver)
    for change in ({}, {"q": PROBLEM.q}, {"P": PROBLEM.P, "q": PROBLEM.q}):
        solver.update(**change)
        solution = solver.solution()
        assert (solution.found, solution.x, solution.extras) == (False, None, {"status": "not solved yet"})
        x = solver.solve()
        np.testing.assert_allclose(x, [1.0, 0.0], atol=0.05)
        with suppress(ValueError):  # read-only
            x *= 3.0
        for _ in range(2):  # what was handed out is changed
            handed_out = solution.x, solution.z_box, solution.problem.P, solution.problem.q, solution.problem.lb
            for array in filter(lambda array: array is not None, handed_out):
                array += 3.0
            solution = solver.solution()
            np.testing.assert_allclose(solution.x, [1.0, 0.0], atol=0.05)
        assert solution.found
        assert solution.primal_residual() + solution.dual_residual() + solution.duality_gap() < 0.3
    with suppress(Unsupported):
        solver.setup(Problem(np.ones((2, 2)), -np.ones(2), lb=np.zeros(2)))  # the least is -0.5, on a line
        solver.solve()
        assert not solver.solution().found or abs(solver.solution().obj + 0.5) < 0.05


def share_with_threads(name: str, lane: str) -> None:
    small = name not in COMPILED
    d, solver, refused = 6 if small else 200, solvers.get(name, lane, **SETTINGS.get(name, {})), []
    A = np.random.default_rng(0).normal(size=(2 * d, d))
    solver.setup(Problem(A.T @ A, A.T @ np.ones(2 * d), lb=np.full(d, -0.01)))
    best = solver.solve().copy()

    def work(_: int) -> bool:
        try:
            x = solver.solve().copy()
        except ValueError as error:
            refused.append(str(error))
            return True
        return np.allclose(x, best, atol=1e-3) if small else np.array_equal(x, best)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(20 if small else 160)))
    assert all("another thread" in sentence for sentence in refused)
    np.testing.assert_allclose(solver.solve(), best, atol=1e-3)


def refuse_what_is_wrong(name: str, lane: str) -> None:
    solver, fresh, told = solvers.get(name, lane), solvers.get(name, lane), []
    for what, refused in wrong(Lane(lane), name in OURS.split()):
        sentences = {**SENTENCES, **(OF_OURS if name in OURS.split() else {})}
        said = next((words for case, words in sentences.items() if re.search(case, what)), "")
        told += [f"{what}: {fault}" for fault in faults(solver, refused, said, "setup" in what)]
        if "setup" in what and not re.search("indefinite|general", what):
            with pytest.raises((ValueError, Unsupported)):
                refused(fresh)
    for call, _ in FOLLOWS.values():
        with pytest.raises((ValueError, Unsupported), match=r"is not ready until the next good setup|compiled loop"):
            call(fresh)
    assert not told, "\n".join(told)


def wrong(lane: Lane, ours: bool) -> Iterator[tuple[str, Callable[[Solver], object]]]:
    """Calls that a solver refuses, by what is wrong; an indefinite P may pass."""
    for part, (among, entries_of_none, whole) in WRONG.items():
        good = FIELDS[among][part] if among else LB
        for what in entries_of_none:
            whole = {**whole, what: np.where(np.arange(good.size).reshape(good.shape) == 0, float(what), good)}
        for what, array in whole.items():
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
    nothing = np.zeros(0)
    yield "setup, no variables", lambda s: s.setup(Problem(np.zeros((0, 0)), nothing, lb=nothing, ub=nothing))
    for what, bad in (("indefinite P", -P), ("slightly indefinite P", np.diag([1.0, 1.0, -1e-9]))):
        yield f"update, {what}", lambda s, bad=bad: s.update(P=bad)
        yield f"setup, {what}", lambda s, bad=bad: s.setup(Problem(bad, Q[0], lb=LB))
        if lane is Lane.KERNEL:
            yield f"loop, {what}", lambda s, bad=bad: s.time_kernel(bad[None], Q[1:])
    general = {"G": P[:1], "h": ONES[:1]}, {"G": np.eye(3)[:1], "h": ONES[:1]}, {"A": P[:1], "b": ONES[:1]}
    for row in general if ours else ():
        yield f"setup, general row {row}", lambda s, row=row: s.setup(Problem(P, Q[0], lb=LB, **row))


def faults(solver: Solver, refused: Callable[[Solver], object], said: str, of_setup: bool) -> Iterator[str]:
    """What is wrong about a refusal, and about each of the calls that may follow it; without a sentence, the solver may
    take the data or refuse them in its own words. A refused ``setup`` leaves it as it was, ours to the last bit."""
    is_ready, refusals = False, (ValueError, Unsupported) if said else (Exception,)
    for name, (call, which) in FOLLOWS.items():
        if not is_ready:
            solver.setup(Problem(**FIELDS["P"]))
            before = solver.solve().copy()
        try:
            refused(solver)
        except refusals as error:
            if "\n" in str(error) or not re.search(f"{said}|takes bounds only", str(error)):
                yield f"refused in other words: {error}"
        else:
            if said:
                yield "taken"
            return
        try:
            x, is_ready = call(solver), True
        except (ValueError, Unsupported) as error:
            is_ready = isinstance(error, Unsupported)  # there is no loop
            if not is_ready and (of_setup or "is not ready until" not in str(error)):
                yield f"then {name}: {error}"
        else:
            is_kept = of_setup and which == 0 and (name == "solution" or solver.name in OURS.split())
            if x is not None and not (
                np.array_equal(x, before) if is_kept else np.allclose(x, ANSWERS[which], atol=0.05)
            ):
                yield f"then {name}: {x} for {before if is_kept else ANSWERS[which]}"


PROMISES = {
    keep_the_promises: "it refuses copies in one sentence and has no answer before a solve of the present data, and no "
    "wrong one for a singular P",
    refuse_what_is_wrong: "it refuses wrong data and starts before a library sees them and is as it was or not ready",
    share_with_threads: "in use it is refused to a second thread and each answer is right",
}


def marks_of(entry: Entry, promises: Callable[[str, str], None]) -> list[pytest.MarkDecorator]:
    """JAX traces every call, a commercial library has a process for each promise, and the packages of two lanes refuse
    in one class what is wrong, whichever library is behind it; with JAX this takes minutes."""
    one_class = promises is refuse_what_is_wrong and entry.lane in (Lane.QPSOLVERS, Lane.CVXPY)
    slow = entry.name in ("qpax", *COMMERCIAL) or (one_class and entry.name not in ("daqp", "highs", "clarabel"))
    return [pytest.mark.slow] * slow + [pytest.mark.nightly] * (one_class and entry.name == "qpax")


@pytest.mark.filterwarnings("ignore::UserWarning")  # of qpsolvers and cvxpy, and true
@pytest.mark.parametrize(
    ("entry", "promises"),
    [
        pytest.param(e, f, id=f"{e.lane} {e.name}-{words}", marks=marks_of(e, f))
        for e, (f, words) in product(entries(), PROMISES.items())
    ],
)
def test_a_solver_keeps_its_contract(entry: Entry, promises: Callable[[str, str], None]) -> None:
    solver_class(entry)
    if entry.name not in COMMERCIAL:
        promises(entry.name, entry.lane)
        return
    python("-c", f"import sys, test_contract as t; t.{promises.__name__}(*sys.argv[1:])", entry.name, entry.lane)


REMOVED: dict[str, tuple[Any, str, Any, dict[str, Any]]] = {
    "expected shape": (arrays.shaped, "__code__", (lambda name, values, shape: values).__code__, {"lb": np.zeros(2)}),
    "must be finite": (
        checks.finite,
        "__code__",
        (lambda name, values, shape, absent: values).__code__,
        {"lb": LB * np.nan},
    ),
    "lies above": (rows, "check_status", lambda *status, **data: None, {"lb": np.full(3, 9.5)}),
    "not symmetric": (rows, "check_status", lambda *status, **data: None, {"P": WRONG["P"][2]["asymmetric"]}),
}
"""The function that makes each check of a program, what replaces it, and data that only this check refuses."""


@pytest.mark.parametrize("what", REMOVED)
def test_a_check_of_a_program_stands_in_one_function_and_without_it_no_adapter_refuses(
    what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    owner, name, replacement, wrong_data = REMOVED[what]
    classes = [entry.load() for entry in available() if entry.name not in COMMERCIAL and entry.path is None]

    def refused(cls: type[Solver]) -> bool:
        monkeypatch.setattr(cls, "build", lambda self, program, rows: None)
        try:
            cls().setup(Problem(**FIELDS["ub"] | wrong_data))
        except (ValueError, IndexError, Unsupported) as error:
            return what in str(error)
        return False

    assert all(map(refused, classes))
    monkeypatch.setattr(owner, name, replacement)
    assert not any(map(refused, classes))


def refuse_copies(solver: solvers.Solver) -> None:
    for way in COPIES.values():
        remedy = (
            f"cannot be copied or pickled; set up another one, by solvers.get({solver.name!r}, **settings) and setup("
        )
        with pytest.raises(TypeError, match=rf"\A.*{re.escape(remedy)}.*\Z"):
            way(solver)


def test_the_default_race_is_of_these_solvers_and_lanes_and_ours_are_those_of_this_package() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    of_make = ["piezobench", *project["dependencies"], *extras["field"], *extras["copyleft"]]
    installed = {re.match(r"[\w-]+", words)[0] for words in of_make}
    race = {(entry.lane, entry.name) for entry in available() if entry.load().distribution in installed}
    assert registry.OURS - {"recursive_active_set"} == {
        entry.name for entry in available() if entry.load().distribution == "piezobench"
    }
    named = {(Lane(lane), name) for lane, names in DEFAULT_RACE.items() for name in names.split()}
    assert race <= named
    assert {name for _, name in named - race} <= (
        set() if ALL else {"proxsuite", "proxqp"}  # which need a library of the system
    )


EYE, ONES, ZEROS = np.eye(2), np.ones(2), np.zeros(2)
SETTINGS: dict[str, dict[str, Any]] = {
    "box_active_set": {},
    "projected_difference": {"steps": 20},
    "accelerated_projection": {"diagonal_scaling": True},
}
each_of_ours = pytest.mark.parametrize("name", SETTINGS)


def ready(name: str, problem: Problem) -> Solver:
    return set_up(name, problem, **SETTINGS[name])


def boxed(P: object, q: object) -> Problem:
    return Problem(P, q, lb=np.full(2, -INF), ub=np.full(2, INF))


NOT_NUMBERS = {
    "NaN in P": ({"P": np.diag([1.0, np.nan]), "q": ZEROS}, "P must be finite"),
    "infinite q": ({"P": EYE, "q": np.array([-INF, 0.0])}, "q must be finite"),
    "NaN in q alone": ({"q": np.array([np.nan, 0.0])}, "q must be finite"),
    "not symmetric": ({"P": np.array([[1.0, 0.5], [0.0, 1.0]])}, "P is not symmetric"),
    "indefinite": ({"P": np.array([[1.0, 2.0], [2.0, 1.0]]), "q": ZEROS}, "P is indefinite"),
    "a negative diagonal": ({"P": -EYE}, "P is indefinite"),
}


@pytest.mark.parametrize("what", NOT_NUMBERS)
@each_of_ours
def test_after_a_refused_update_nothing_is_answered_until_its_arrays_come_again_which_may_be_one_alone(
    name: str, what: str
) -> None:
    data, sentence = NOT_NUMBERS[what]
    solver = ready(name, boxed(2.0 * EYE, -ONES))
    solver.solve()
    with pytest.raises(ValueError, match=f"^{name}: {sentence}"):
        solver.update(**data)
    for call in (solver.solve, solver.solution, lambda: solver.solve(ZEROS)):
        with pytest.raises(ValueError, match=f"not ready until the next good update of {' and '.join(sorted(data))}$"):
            call()
    good = {"P": EYE, "q": -ONES}
    if len(data) == 2:
        solver.update(q=good["q"])
        with pytest.raises(ValueError, match=r"not ready until the next good update of P$"):
            solver.solve()
    solver.update(**{key: good[key] for key in data})
    fresh = ready(name, boxed(good["P"] if "P" in data else 2.0 * EYE, -ONES))
    np.testing.assert_array_equal(solver.solve(), fresh.solve())
    assert solver.solution().found
    np.testing.assert_array_equal(solver.solution().problem.P, fresh.solution().problem.P)


@pytest.mark.parametrize(
    ("name", "settings", "sentence"),
    [
        *((name, {"stpes": 3}, f"{name} has no setting 'stpes'; it has ") for name in SETTINGS),
        (
            "box_active_set",
            {"tolerance": 1e-9},
            "box_active_set has no setting 'tolerance'; it has warm, most_exchanges",
        ),
        ("box_active_set", {"warm": "no"}, "box_active_set: warm must be True or False, not 'no'"),
        ("box_active_set", {"most_exchanges": -1}, "most_exchanges must be a whole number from 0 to 2147483647"),
        ("projected_difference", {"steps": 1.5}, "projected_difference: steps must be a whole number from 0 to"),
        ("projected_difference", {"tolerance": -1.0}, "tolerance must be a number of at least 0, not -1.0"),
        ("projected_difference", {"step_ratio": np.nan}, "step_ratio must be a number of at least 0"),
        ("projected_difference", {"step_ratio": 1.0}, "step_ratio must lie between 0 and 1"),
        ("projected_difference", {"step_ratio": 0.0, "allow_divergence": True}, "step_ratio"),
        ("accelerated_projection", {"tolerance": -1.0}, "tolerance must be a number of at least 0, not -1.0"),
        ("accelerated_projection", {"tolerance": None}, "tolerance must be a number of at least 0, not None"),
        ("accelerated_projection", {"diagonal_scaling": 1}, "diagonal_scaling must be True or False, not 1"),
    ],
)
def test_a_setting_that_is_misspelt_or_out_of_range_is_refused(name: str, settings: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        solvers.get(name, **settings)


AS_GIVEN: dict[str, Callable[[np.ndarray], Any]] = {
    "contiguous": np.array,
    "Fortran": np.asfortranarray,
    "strided": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "single precision": np.float32,
    "other byte order": lambda a: a.astype(">f8"),
    "list": np.ndarray.tolist,
    "subclass": np.ma.array,
    "pickled": lambda a: pickle.loads(pickle.dumps(a)),
    "locked": lambda a: np.broadcast_to(a, a.shape),
}


@pytest.mark.parametrize("form", AS_GIVEN)
def test_data_may_come_in_any_form_that_numpy_takes(form: str) -> None:
    P, q = np.array([[2.0, 0.5], [0.5, 3.0]]), -ONES
    solver = ready("box_active_set", boxed(EYE, ZEROS))
    solver.update(AS_GIVEN[form](P), AS_GIVEN[form](q))
    np.testing.assert_allclose(P @ solver.solve(), [1.0, 1.0], atol=1e-14)


@each_of_ours
def test_many_updates_and_solves_allocate_nothing_that_stays(name: str) -> None:
    P, q, *_ = random_program(10, 18, 2.0)
    solver = ready(name, Problem(P, q, lb=np.zeros(18)))
    tracemalloc.start()
    for calls in (10, 500):  # the first ten may fill caches
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(calls):
            solver.update(q=q)
            solver.solve()
    left = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert left < calls * sys.getsizeof(object())  # not one object a call
