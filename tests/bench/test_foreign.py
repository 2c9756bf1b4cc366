"""Programs of others: read to the last bit, scaled without rounding, certified or left out, and judged."""

from __future__ import annotations

import json
import multiprocessing
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.sparse as sp
from command_line import CommandLine
from program_files import INF, Drawn, draw, write_mat, write_qps
from qpsolvers import Problem
from scipy.io import savemat

from bench.passed import user_cache
from bench.passed.outcome import Outcome
from bench.passed.task import Task
from bench.problem_files import ProblemFileError, read
from bench.problem_files.npz import QP_FIELDS
from bench.problems import ProblemSetError, RaceProblem, make
from bench.problems.certifying import Prover, Provers
from bench.problems.equilibration import equilibrated
from bench.problems.protocol import SCALINGS
from bench.processes.solver_child import SolverChild
from bench.races.metrics import judge
from bench.races.oneshot.worker import OneShot
from solvers import Lane, Status, Tier, find
from solvers.certificate import verify

SMALL = """NAME          SMALL
ROWS
 N  COST
 G  R1
 L  R2
 E  R3
 E  R4
 N  FREE
COLUMNS
    C1        COST      1.5        R1        2.0
    C1        R2        -1.0       R3        1E-11
    C2        COST      -2.0       R1        1.0
    C2        R2        2.0        R4        1.0
    C3        R3        1.0        FREE      3.0
    C4        R4        1.0D0
RHS
    RHS       COST      -4.0       R1        2.0
    RHS       R2        6.0        R3        1.0
RANGES
    RNG       R1        5.0        R2        1.0
    RNG       R3        -2.0       R4        0.5
BOUNDS
 UP BND       C1        20.0
 FR BND       C3
 UP BND       C2        -3.0
 MI BND       C4
 PL BND       C4
QUADOBJ
    C1        C1        8.0
    C1        C2        2.0
    C2        C2        10.0
    C3        C3        1E-12
ENDATA
"""


def dense(matrix: object) -> np.ndarray:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def same(a: Problem, b: Problem) -> bool:
    pairs = [(getattr(a, name), getattr(b, name)) for name in QP_FIELDS]
    return all((x is None and y is None) or np.array_equal(dense(x), dense(y)) for x, y in pairs)


def qps(folder: Path, text: str) -> Path:
    path = folder / "small.qps"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One program in each format, and all that can be wrong with one."""
    path = tmp_path_factory.mktemp("programs")
    write_mat(path / "drawn.mat", draw(0))
    write_qps(path / "drawn.QPS", draw(0))
    write_qps(path / "other.mps", draw(1))
    eye, zero, one = np.eye(2), np.zeros(2), np.ones(2)
    np.savez(path / "dense.npz", P=eye, q=-one, G=np.array([[1.0, 1.0]]), h=np.array([1.0]), c=2.0)
    np.savez(path / "indefinite.npz", P=np.diag([1.0, -1.0]), q=zero)
    np.savez(path / "infeasible.npz", P=eye, q=zero, lb=one, ub=-one)
    np.savez(path / "unbounded.npz", P=np.diag([1.0, 0.0]), q=-one, lb=zero)
    np.savez(path / "large.npz", **{f"P/{part}": getattr(sp.identity(2500, format="csc"), part)
                                    for part in ("data", "indices", "indptr", "shape")}, q=np.zeros(2500))
    (path / "broken.npz").write_bytes(b"PK and no more")
    (path / "notes.txt").write_text("no program")
    return path


@pytest.fixture(scope="module")
def foreign(folder: Path) -> tuple[dict[str, RaceProblem], dict[str, str]]:
    made = make("foreign", options={"folder": str(folder)})
    problems = {problem.name: problem for problem in made.problems()}
    assert len(problems) + len(made.left_out) == len(made)
    return problems, made.left_out


def test_rows_ranges_bounds_and_the_quadratic_part_of_a_qps_file_are_read(tmp_path: Path) -> None:
    found = read(qps(tmp_path, SMALL))
    qp = found.qp
    assert found.constant == 4.0
    assert dense(qp.P).tolist() == [[8, 2, 0, 0], [2, 10, 0, 0], [0, 0, 1e-12, 0], [0, 0, 0, 0]]
    assert qp.q.tolist() == [1.5, -2.0, 0.0, 0.0]
    rows = [[2, 1, 0, 0], [-1, 2, 0, 0], [1e-11, 0, 1, 0], [0, 1, 0, 1]]
    assert dense(qp.G).tolist() == rows + (-np.array(rows)).tolist()
    assert qp.h.tolist() == [7, 6, 1, 0.5, -2, -5, 1, 0]
    assert qp.A is None
    assert qp.lb.tolist() == [0, -np.inf, -np.inf, -np.inf]
    assert qp.ub.tolist() == [20, -3, np.inf, np.inf]
    assert sp.issparse(qp.P)
    assert sp.issparse(qp.G)


def test_all_of_p_and_a_maximum_are_read_too(tmp_path: Path) -> None:
    whole = SMALL.replace("QUADOBJ", "QMATRIX").replace("    C2        C2        10.0",
                                                      "    C2        C1        2.0\n    C2        C2        10.0")
    assert same(read(qps(tmp_path, whole)).qp, read(qps(tmp_path, SMALL)).qp)
    least, most = read(qps(tmp_path, SMALL)), read(qps(tmp_path, SMALL.replace("ROWS", "OBJSENSE\n    MAX\nROWS", 1)))
    assert np.array_equal(most.qp.q, -least.qp.q)
    assert np.array_equal(dense(most.qp.P), -dense(least.qp.P))
    assert most.constant == -least.constant


def test_names_of_vectors_may_be_left_out_and_names_may_hold_blanks_in_fixed_columns(tmp_path: Path) -> None:
    unnamed = SMALL
    for name in ("RHS       ", "RNG       ", "BND       "):
        unnamed = unnamed.replace(f"    {name}", "    ").replace(f" {name}", " ")
    assert same(read(qps(tmp_path, unnamed)).qp, read(qps(tmp_path, SMALL)).qp)
    lines = ["NAME", "ROWS", " N  THE COST", " L  ROW 1", "COLUMNS", "    COL 1     THE COST  -1.0           ROW 1     2.0",
             "RHS", "    RHS       ROW 1     3.0", "QUADOBJ", "    COL 1     COL 1     4.0", "ENDATA"]
    found = read(qps(tmp_path, "\n".join(lines))).qp
    assert (found.q.tolist(), dense(found.G).tolist(), found.h.tolist(), dense(found.P).tolist()) == (
        [-1.0], [[2.0]], [3.0], [[4.0]])


@pytest.mark.parametrize(("old", "new", "sentence"), [
    ("ENDATA", "", "ends without ENDATA"),
    ("20.0", "2o", "line 23: '2o' is no number"),
    (" UP BND       C1", " BV BND       C1", "line 23: the kind of bound 'BV'"),
    ("R4        1.0D0", "R9        1.0", "line 15: there is no row 'R9'"),
    ("    C3        C3        1E-12", "    C9        C3        1.0", "there is no column 'C9'"),
    ("    C2        C2        10.0", "    C2        C1        10.0", "both sides of the diagonal"),
    (" L  R2", " X  R2", "line 5: the kind of row 'X'"),
    ("    C1        R2        -1.0       R3        1E-11", "    C1        R1        -1.0", "the element R1, C1 is given twice"),
    ("    RHS       R2        6.0", "    OTHER     R2        6.0", "a second vector 'OTHER'"),
    ("RANGES", "CONES", "the section 'CONES' is not one of"),
    ("    C3        R3", "    M  'MARKER'  'INTORG'\n    C3        R3", "integer variables"),
    ("R2        6.0", "R2        nan", "line 18: 'nan' is no number"),
    ("R2        6.0", "R2        -1E30", "line 18: no number is -1E30 or below, which the row 'R2' asks for"),
    ("COST      -4.0", "COST      inf", "line 17: 'inf' is no finite number"),
    ("R1        5.0", "R1        NaN", "line 20: 'NaN' is no number"),
    ("C1        20.0", "C1        nan", "line 23: 'nan' is no number"),
    ("C1        20.0", "C1        1_0", "line 23: '1_0' is no number"),
    ("C1        20.0", "C1        -inf", "line 23: no number of the column 'C1' is within the bound -inf"),
    (" MI BND       C4", " UP BND       C2        9.0", "line 26: the upper bound of the column 'C2' is given twice, as -3 and as 9"),
    ("    C3        C3        1E-12", "    C3        C3        inf", "'inf' is no finite number"),
    ("QUADOBJ", "RHS\n    RHS       R4        9.0\nQUADOBJ", "line 28: a second RHS section"),
])
def test_what_is_wrong_with_a_qps_file_is_said_with_file_and_line(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in SMALL
    with pytest.raises(ProblemFileError, match=r"small\.qps: ") as refused:
        read(qps(tmp_path, SMALL.replace(old, new, 1)))
    assert sentence in str(refused.value)


@pytest.mark.parametrize("seed", range(4))
def test_highs_reads_the_same_program_from_the_same_file(tmp_path: Path, seed: int) -> None:
    highspy = pytest.importorskip("highspy", reason="highspy is not installed, and it is what our reader is compared with")
    path = write_qps(tmp_path / "drawn.mps", draw(seed))
    engine = highspy.Highs()
    engine.silent()
    engine.readModel(str(path))
    lp, hessian = engine.getLp(), engine.getModel().hessian_
    d, m = lp.num_col_, lp.num_row_
    C = sp.csc_matrix((lp.a_matrix_.value_, lp.a_matrix_.index_, lp.a_matrix_.start_), shape=(m, d)).toarray()
    L = sp.csc_matrix((hessian.value_, hessian.index_, hessian.start_), shape=(d, d)).toarray()
    P, low, high = L + np.tril(L, -1).T, np.array(lp.row_lower_), np.array(lp.row_upper_)
    found = read(path)
    np.testing.assert_array_equal(dense(found.qp.P), P)
    np.testing.assert_array_equal(found.qp.q, lp.col_cost_)
    np.testing.assert_array_equal(found.qp.lb, lp.col_lower_)
    np.testing.assert_array_equal(found.qp.ub, lp.col_upper_)
    equal = low == high
    np.testing.assert_array_equal(dense(found.qp.A), C[equal])
    np.testing.assert_array_equal(dense(found.qp.G), np.vstack([C[~equal & np.isfinite(high)], -C[~equal & np.isfinite(low)]]))
    assert found.constant == lp.offset_


@pytest.mark.parametrize("seed", range(4))
def test_a_program_is_the_same_from_mat_and_from_qps_and_what_was_written(tmp_path: Path, seed: int) -> None:
    p = draw(seed)
    a, b = read(write_mat(tmp_path / "drawn.mat", p)), read(write_qps(tmp_path / "drawn.qps", p))
    assert same(a.qp, b.qp)
    assert a.constant == b.constant == p.r
    equal = p.l == p.u
    np.testing.assert_array_equal(dense(a.qp.A), dense(p.C)[equal])
    np.testing.assert_array_equal(a.qp.lb, np.where(p.lb == -INF, -np.inf, p.lb))
    np.testing.assert_array_equal(a.qp.ub, np.where(p.ub == INF, np.inf, p.ub))
    assert sp.issparse(a.qp.P)


def test_files_that_hold_no_program_are_refused_with_the_reason(tmp_path: Path) -> None:
    savemat(tmp_path / "no.mat", {"P": np.eye(2)})
    savemat(tmp_path / "shape.mat", {"P": np.eye(2), "q": np.ones(2), "A": np.eye(3), "l": np.ones(3), "u": np.ones(3)})
    (tmp_path / "text.mat").write_text("no MATLAB file at all")
    whole = write_mat(tmp_path / "cut.mat", draw(0)).read_bytes()
    (tmp_path / "cut.mat").write_bytes(whole[:len(whole) // 2])
    np.savez(tmp_path / "half.npz", P=np.eye(2), q=np.ones(2), G=np.eye(2))
    np.savez(tmp_path / "triangle.npz", P=np.triu(np.ones((2, 2))), q=np.ones(2))
    np.savez(tmp_path / "nan.npz", P=np.eye(2), q=np.array([1.0, np.nan]))
    for name, sentence in (("no.mat", "holds no variable 'q'"), ("shape.mat", "A is of shape"), ("half.npz", "G without h"),
                           ("text.mat", "cannot be read"), ("cut.mat", "cannot be read"),
                           ("triangle.npz", "P is not symmetric"),
                           ("nan.npz", "q has an element that is not a finite number"), ("qp.xml", "unknown suffix"),
                           ("none.npz", "No such file"), ("none.mat", "No such file"), ("none.qps", "No such file")):
        with pytest.raises(ProblemFileError, match=name) as refused:
            read(tmp_path / name)
        assert sentence in str(refused.value)


INDEX_ARRAYS = {
    "indices": ([0, 7], "P has an element outside its 2 rows"), "indptr": ([0, 3, 2], "P has columns that do not begin"),
    "shape": ([2, 9], "P is of shape (2, 9) and its index arrays are not"), "data": ([1.0 + 1j, 1.0], "P holds complex numbers")}


@pytest.mark.parametrize(("part", "wrong", "sentence"), [(part, *pair) for part, pair in INDEX_ARRAYS.items()])
def test_index_arrays_that_lie_are_refused_before_anything_follows_them(
        piezobench: CommandLine, tmp_path: Path, part: str, wrong: list[float], sentence: str) -> None:
    P = {"data": np.ones(2), "indices": np.array([0, 1]), "indptr": np.array([0, 1, 2]), "shape": np.array([2, 2]), part: np.array(wrong)}
    np.savez(tmp_path / "lies.npz", q=np.ones(2), **{f"P/{name}": value for name, value in P.items()})
    call = piezobench("problems", "--set", "foreign", "--folder", tmp_path)
    assert call.status == 2, call.stderr
    assert f"lies.npz: cannot be read as NPZ: {sentence}" in " ".join(call.stdout.split())


def test_index_arrays_that_lie_in_a_matlab_file_are_refused_too(tmp_path: Path) -> None:
    savemat(tmp_path / "lies.mat", {"P": sp.csc_matrix(np.eye(3)), "q": np.ones(3)}, do_compression=False)
    whole, rows = (tmp_path / "lies.mat").read_bytes(), np.arange(3, dtype=np.int32).tobytes()
    assert whole.count(rows) >= 1
    (tmp_path / "lies.mat").write_bytes(whole.replace(rows, np.array([0, 1, 10**6], dtype=np.int32).tobytes(), 1))
    with pytest.raises(ProblemFileError, match=r"lies\.mat: P has an element outside its 3 rows"):
        read(tmp_path / "lies.mat")


WHOLE = {"P": np.eye(2), "q": np.ones(2)}


@pytest.mark.parametrize(("arrays", "sentence"), [
    ({"P": np.eye(2) * 1j}, "P holds complex numbers"), ({"q": np.ones(2) + 1j}, "q holds complex numbers"),
    ({"P": np.diag([1.0, np.inf])}, "P has an element that is not a finite number"),
    ({"q": np.array(["1", "2"])}, "q holds no numbers"), ({"q": np.array([2**63 - 1, 1])}, "q holds numbers that no double is equal to"),
    ({"q": np.ones((2, 2))}, "q is of shape (2, 2) and no vector"),
    ({"r": np.nan}, "the constant r is not one finite number"), ({"r": [1.0, 2.0]}, "the constant r is not one finite number"),
    ({"A": np.eye(2), "l": [0.0, np.nan], "u": np.ones(2)}, "l[1] is nan, and nothing is within that"),
    ({"A": np.eye(2), "l": np.zeros(2), "u": [-1e30, 1.0]}, "u[0] is -inf, and nothing is within that"),
    ({"G": np.eye(2), "h": [np.nan, 1.0]}, "h[0] is nan, and nothing is within that"),
    ({"lb": [0.0, np.inf]}, "lb[1] is inf, and nothing is within that"), ({"ub": [np.nan, 1.0]}, "ub[0] is nan"),
], ids=str)
def test_numbers_that_would_change_the_program_are_refused(tmp_path: Path, arrays: dict[str, object], sentence: str) -> None:
    formats = [".mat"] if "l" in arrays else [".npz"] if arrays.keys() & {"h", "lb", "ub"} else [".mat", ".npz"]
    for suffix in formats:
        path = tmp_path / f"wrong{suffix}"
        (savemat if suffix == ".mat" else np.savez)(path, **({"mdict": {**WHOLE, **arrays}} if suffix == ".mat" else {**WHOLE, **arrays}))
        with pytest.raises(ProblemFileError, match=path.name) as refused:
            read(path)
        assert sentence in str(refused.value)


def test_constraints_under_names_that_are_not_read_are_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "box.mat", {**WHOLE, "lb": np.zeros(2)})
    np.savez(tmp_path / "sides.npz", **WHOLE, u=np.ones(2))
    for name, sentence in (("box.mat", "holds lb, which is not read"), ("sides.npz", "holds u, which is not read")):
        with pytest.raises(ProblemFileError, match=sentence):
            read(tmp_path / name)


def test_a_saved_problem_with_a_constant_or_a_bound_that_is_no_number_is_left_out(tmp_path: Path) -> None:
    problem = next(make("paper").problems())
    form = problem.forms["raw"]
    replace(problem, forms={"raw": replace(form, c=np.nan)}).save(tmp_path / "constant.npz")
    lb = np.where(np.arange(problem.d) == 3, np.nan, form.qp.lb)
    qp = Problem(form.qp.P, form.qp.q, lb=lb, ub=form.qp.ub)
    replace(problem, forms={"raw": replace(form, qp=qp)}).save(tmp_path / "bound.npz")
    made = make("foreign", options={"folder": str(tmp_path)})
    assert list(made.problems()) == []
    assert "constant.npz: cannot be read as NPZ" in made.left_out["constant"]  # NaN is no JSON
    assert "nan" in made.left_out["bound"]


def test_files_that_qpsolvers_saved_are_read_and_its_pickled_matrices_are_not(tmp_path: Path) -> None:
    qp = Problem(np.eye(2), np.ones(2), np.ones((1, 2)), np.ones(1), lb=np.zeros(2))
    qp.save(str(tmp_path / "theirs.npz"))
    assert same(read(tmp_path / "theirs.npz").qp, qp)
    np.savez(tmp_path / "pickled.npz", P=np.eye(2), q=np.ones(2), G=np.array(None), h=np.ones(1))
    with pytest.raises(ProblemFileError, match="G is stored as a Python object, which is not read"):
        read(tmp_path / "pickled.npz")


@pytest.mark.parametrize("seed", range(4))
def test_scaling_is_by_powers_of_two_and_rounds_nothing(tmp_path: Path, seed: int) -> None:
    qp = read(write_mat(tmp_path / "drawn.mat", draw(seed))).qp
    badly = np.exp2(np.arange(qp.q.size) * 3 - 17)
    qp = Problem(sp.csc_matrix(sp.diags(badly) @ qp.P @ sp.diags(badly)), badly * qp.q, qp.G @ sp.diags(badly), qp.h,
                 qp.A @ sp.diags(badly), qp.b, qp.lb / badly, qp.ub / badly)
    scaled = equilibrated(qp)
    D, kappa = scaled.unit, scaled.cost
    assert np.all(np.frexp(np.append(D, kappa))[0] == 0.5)
    back = sp.diags(1.0 / D)
    np.testing.assert_array_equal(dense(back @ scaled.qp.P @ back) / kappa, dense(qp.P))
    np.testing.assert_array_equal(scaled.qp.q / D / kappa, qp.q)
    for M, right, M_scaled, right_scaled in ((qp.G, qp.h, scaled.qp.G, scaled.qp.h), (qp.A, qp.b, scaled.qp.A, scaled.qp.b)):
        E = dense(abs(M_scaled @ back)).max(axis=1) / dense(abs(M)).max(axis=1)
        np.testing.assert_array_equal(dense(sp.diags(1.0 / E) @ M_scaled @ back), dense(M))
        np.testing.assert_array_equal(right_scaled / E, right)
    np.testing.assert_array_equal(scaled.qp.lb * D, qp.lb)
    largest = dense(sp.vstack([abs(scaled.qp.P / kappa), abs(scaled.qp.G), abs(scaled.qp.A)]).max(axis=0))
    assert largest.min() > 0.2
    assert largest.max() < 5.0


def test_programs_of_every_format_are_certified_in_both_scalings(foreign: tuple[dict[str, RaceProblem], dict[str, str]]) -> None:
    assert set(foreign[0]) == {"drawn.mat", "drawn.QPS", "other", "dense"}
    for problem in foreign[0].values():
        raw, scaled = problem.forms["raw"], problem.forms["scaled"]
        for form in (raw, scaled):
            verify(form.qp, form.certificate)
        assert list(scaled.certificate.active()) == list(raw.certificate.active())
        np.testing.assert_array_equal(scaled.to_weights @ np.array(scaled.certificate.x), raw.certificate.x)
        assert problem.validation is None
    by_mat, by_qps = (foreign[0][name].forms["raw"] for name in ("drawn.mat", "drawn.QPS"))
    assert by_mat.certificate == by_qps.certificate
    assert foreign[0]["dense"].forms["raw"].certificate.value == "-3/4"
    assert foreign[0]["dense"].forms["raw"].c == 2.0


@pytest.mark.parametrize(("name", "reason"), [
    ("indefinite", "P is not convex"), ("infeasible", "contradict each other"), ("unbounded", "falls without bound"),
    ("large", "2500 variables with 0 rows are too many"), ("broken", "cannot be read as NPZ"),
])
def test_what_cannot_be_certified_is_left_out_with_the_reason(foreign: tuple[dict[str, RaceProblem], dict[str, str]],
                                                              name: str, reason: str) -> None:
    assert name not in foreign[0]
    assert reason in foreign[1][name]


def test_a_proof_that_takes_too_much_work_is_given_up_and_said(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    M = rng.normal(size=(400, 400))
    np.savez(tmp_path / "long.npz", P=M @ M.T, q=rng.normal(size=400), lb=np.zeros(400))
    np.savez(tmp_path / "quick.npz", P=np.eye(2), q=np.ones(2))
    made = make("foreign", options={"folder": str(tmp_path), "work": "1e8"})
    assert [problem.name for problem in made.problems()] == ["quick"]
    assert made.left_out == {"long": "no proof within 1e+08 bit operations of exact arithmetic"}


def test_proofs_and_refusals_are_kept_by_the_data_and_found_again_without_a_process(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez(tmp_path / "good.npz", P=np.diag([2.0, 3.0]), q=np.array([-1.0, 1.25]), lb=np.zeros(2))
    np.savez(tmp_path / "endless.npz", P=np.diag([2.0, 0.0]), q=np.array([-1.0, -1.25]), lb=np.zeros(2))
    options = {"folder": str(tmp_path)}
    first = make("foreign", options=options)
    proven = next(first.problems())
    with monkeypatch.context() as patch:
        patch.setattr(Prover, "prove", lambda *_: pytest.fail("a proof was looked for again"))
        again = make("foreign", options=options)
        assert [{s: f.certificate for s, f in problem.forms.items()} for problem in again.problems()] == [
            {s: f.certificate for s, f in proven.forms.items()}]
        assert "falls without bound" in again.left_out["endless"]
    for kept in user_cache.folder("proofs").glob("*.json"):
        kept.write_text(kept.read_text()[:40])
    np.savez(tmp_path / "good.npz", P=np.diag([2.0, 3.0]), q=np.array([-1.0, 1.5]), lb=np.zeros(2))
    other = next(make("foreign", options=options).problems())
    assert other.forms["raw"].certificate.problem != proven.forms["raw"].certificate.problem
    verify(other.forms["raw"].qp, other.forms["raw"].certificate)


def test_a_race_lists_all_that_it_leaves_out_with_the_reason(piezobench: CommandLine, folder: Path, tmp_path: Path) -> None:
    words = ("race", "--lane", "qpsolvers", "--solver", "daqp", "--tier", "default", "--budget", 0.001, "--rounds", 0, "--out", tmp_path)
    call = piezobench(*words, "--folder", folder, "--name", "run")
    assert call.status == 0, call.stderr
    noted = json.loads((tmp_path / "run" / "run.json").read_text())["left_out"]["foreign"]
    assert sorted(noted) == ["broken", "indefinite", "infeasible", "large", "unbounded"]
    shown = " ".join(call.stdout.split())
    assert "5 of 9 problems" in shown
    pages = [" ".join((tmp_path / "run" / name).read_text().split()) for name in ("report.md", "report.html")]
    for name, why in noted.items():
        assert f"foreign/{name}: {' '.join(why.split())[:60]}" in shown
        assert all(f"foreign/{name}" in page for page in pages)
    (tmp_path / "bad").mkdir()
    np.savez(tmp_path / "bad" / "indefinite.npz", P=np.diag([1.0, -1.0]), q=np.zeros(2))
    assert "no problem of the set 'foreign' can be raced; indefinite: P is not convex" in piezobench(
        *words, "--folder", tmp_path / "bad", "--name", "none").refusal


def test_test_sets_of_qpbenchmark_are_read_from_their_class(piezobench: CommandLine, folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("qpbenchmark", reason="qpbenchmark is not installed, and it is its test sets that are read")
    call = piezobench("problems", "--set", "foreign", "--folder", folder, "--export", tmp_path)
    assert call.status == 0, call.stderr
    made = make("test_set", options={"test_set": str(tmp_path / "piezobench_foreign.py")})
    found = {problem.name: problem for problem in made.problems()}
    saved = [RaceProblem.load(path) for path in tmp_path.glob("*.npz")]
    assert not made.left_out
    assert len(found) == len(made) == 2 * len(saved)
    for problem in saved:
        for scaling, form in problem.forms.items():
            assert found[f"foreign--{problem.name}--{scaling}"].forms["raw"].certificate.x == form.certificate.x
    (tmp_path / "mine.py").write_text("from qpbenchmark import Problem\nclass Mine:\n    def __iter__(self):\n        raise OSError('no network')\n")
    with pytest.raises(ProblemSetError, match=r"mine\.py: OSError: no network"):
        list(make("test_set", options={"test_set": str(tmp_path / "mine.py")}).problems())
    (tmp_path / "mine.py").write_text("")
    assert "has no class Mine" in piezobench("problems", "--set", "test_set", "--test-set", tmp_path / "mine.py").refusal


def test_the_command_in_an_exported_set_saves_its_results(piezobench: CommandLine, tmp_path: Path) -> None:
    pytest.importorskip("qpbenchmark", reason="qpbenchmark is not installed, and it is what runs an exported set")
    call = piezobench("problems", "--set", "measured", "--limit", 1, "--export", tmp_path)
    assert call.status == 0, call.stderr
    command = next(line.split() for line in (tmp_path / "piezobench_measured.py").read_text().splitlines() if "run --author" in line)
    done = subprocess.run([sys.executable, *command[1:2], "run", "--author", "you", "--solver", "quadprog"],
                          cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = pd.read_csv(tmp_path / "piezobench_measured.csv")
    assert rows.problem.nunique() == 2
    assert rows.found.all()
    assert (tmp_path / "piezobench_measured.md").is_file()


def test_a_gap_is_relative_to_the_larger_part_of_the_optimal_cost(tmp_path: Path) -> None:
    np.savez(tmp_path / "far.npz", P=np.diag([2e4, 1.0]), q=np.array([-2e6, 0.0]), c=1e6)
    problem = next(make("foreign", options={"folder": str(tmp_path)}).problems())
    for form in problem.forms.values():  # at x* = (100, 0) the parts are 1e8 and 2e8
        assert form.yardstick == pytest.approx(2e8 * form.cost_unit)
        x = np.linalg.solve(dense(form.to_weights), np.array([100.0, 20.0]))
        scaling = next(s for s, f in problem.forms.items() if f is form)
        assert judge(problem, scaling, Outcome(found=True, x=x)).cost_gap == pytest.approx(1e-6)


def test_sparse_problems_with_rows_are_saved_and_loaded_to_the_last_bit(foreign: tuple[dict[str, RaceProblem], dict[str, str]],
                                                                       tmp_path: Path) -> None:
    for problem in foreign[0].values():
        problem.save(tmp_path / "problem.npz")
        loaded = RaceProblem.load(tmp_path / "problem.npz")
        for scaling in SCALINGS:
            ours, theirs = problem.forms[scaling], loaded.forms[scaling]
            assert same(ours.qp, theirs.qp)
            assert sp.issparse(theirs.qp.P) == sp.issparse(ours.qp.P)
            assert np.array_equal(dense(ours.to_weights), dense(theirs.to_weights))
            assert (ours.certificate, ours.c, ours.cost_unit) == (theirs.certificate, theirs.c, theirs.cost_unit)
            verify(theirs.qp, theirs.certificate)


def test_a_problem_that_was_saved_here_keeps_its_forms_and_its_proofs(tmp_path: Path) -> None:
    problem = next(make("paper").problems())
    problem.save(tmp_path / "mine.npz")
    found = list(make("foreign", options={"folder": str(tmp_path)}).problems())
    assert [(p.set_name, p.name) for p in found] == [("foreign", "mine")]
    assert {s: f.certificate for s, f in found[0].forms.items()} == {s: f.certificate for s, f in problem.forms.items()}
    assert found[0].validation is not None


@pytest.mark.parametrize("scaling", SCALINGS)
@pytest.mark.parametrize("name", ["drawn.mat", "dense"])
def test_rows_are_judged_by_the_distance_to_the_nearest_feasible_point(
        foreign: tuple[dict[str, RaceProblem], dict[str, str]], name: str, scaling: str) -> None:
    problem = foreign[0][name]
    form = problem.forms[scaling]
    best = np.array(form.certificate.x)
    right = judge(problem, scaling, Outcome(found=True, x=best)).at(Tier.HIGH)
    assert (right.status, right.weight_error, np.isnan(right.model_error_percent)) == (Status.OK, 0.0, True)
    rows = dense(form.qp.G)
    k = int(np.argmin(form.qp.h - rows @ best))  # an active row, and a step of 1e-3 across it
    wrong = judge(problem, scaling, Outcome(found=True, x=best + 1e-3 * rows[k] / (rows[k] @ rows[k]))).at(Tier.HIGH)
    assert wrong.status == Status.MISSED
    assert wrong.violation > 1e-5


@pytest.mark.parametrize("scaling", SCALINGS)
def test_the_cost_gap_of_a_program_whose_optimal_cost_is_zero_is_measured_in_its_unit(tmp_path: Path, scaling: str) -> None:
    np.savez(tmp_path / "zero.npz", P=np.diag([2e4, 2e4]), q=np.zeros(2), A=np.ones((1, 2)), b=np.zeros(1))
    problem = next(make("foreign", options={"folder": str(tmp_path)}).problems())
    form = problem.forms[scaling]
    assert form.certificate.value == "0"
    x = np.linalg.solve(dense(form.to_weights), np.array([1e-6, -1e-6]))
    verdict = judge(problem, scaling, Outcome(found=True, x=x)).at(Tier.HIGH)
    assert verdict.cost_gap == pytest.approx(2e-8)
    assert verdict.status == Status.MISSED
    assert judge(problem, scaling, Outcome(found=True, x=x)).at(Tier.MID).status == Status.OK


@pytest.mark.parametrize(("solver", "status"), [("daqp", "ok"), ("clarabel", "ok"), ("box_active_set", "unsupported")])
def test_solvers_answer_foreign_problems_or_say_that_they_cannot_take_them(
        foreign: tuple[dict[str, RaceProblem], dict[str, str]], solver: str, status: str) -> None:
    lane = Lane.DIRECT if solver == "box_active_set" else Lane.QPSOLVERS
    problem = foreign[0]["other"]
    with SolverChild(find(solver, lane)) as child:
        for scaling in SCALINGS:
            task = Task("foreign", problem.name, scaling, solver, lane, (Tier.HIGH,))
            outcome = child.ask(OneShot.of(task, problem.forms[scaling]))
            assert str(judge(problem, scaling, outcome).at(Tier.HIGH).status) == status, outcome.message
            assert not outcome.mutated


def test_a_folder_without_programs_and_a_limit_that_is_no_number_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ProblemSetError, match=r"holds no program; one is in a file \.npz, \.mat, \.qps, \.mps"):
        make("foreign", options={"folder": str(tmp_path)})
    write_mat(tmp_path / "drawn.mat", draw(0))
    with pytest.raises(ProblemSetError, match="work is 'soon'"):
        make("foreign", options={"folder": str(tmp_path), "work": "soon"})


def test_the_programs_drawn_here_have_what_a_reader_must_take() -> None:
    p: Drawn = draw(0)
    assert np.any(p.l == p.u)
    assert np.any((p.l > -INF) & (p.u < INF) & (p.l < p.u))
    assert np.any((p.lb == -INF) & (p.ub == INF))
    assert np.any(p.lb == p.ub)
    assert p.P.nnz < p.q.size**2
    assert np.linalg.matrix_rank(dense(p.P)) < p.q.size


@pytest.mark.parametrize("pause", [0.0, 0.05, 0.3, 1.0, 3.0])
def test_provers_that_are_left_while_they_start_or_work_end(pause: float) -> None:
    before = set(multiprocessing.active_children())
    with Provers() as provers:
        next(provers.map(lambda prover, seconds: seconds and prover.prove(time.sleep, seconds), [0.0] + 9 * [3600.0]))
        time.sleep(pause)
    assert set(multiprocessing.active_children()) <= before
