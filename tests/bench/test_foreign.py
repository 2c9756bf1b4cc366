"""Foreign programs: scaled without rounding, certified or left out, and judged."""

import gzip
import multiprocessing
import os
import shutil
import signal
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from box_programs import many_weak_rows
from command_line import CommandLine, in_process
from measured_rows import is_right, judged
from program_files import DRAWN, dense, same_problem
from programs import library
from qpsolvers import Problem

from bench.derived.tiers import right
from bench.messages.task import Outcome, Status, Tier
from bench.problem_files import read
from bench.problem_files.npz import packed_program
from bench.problem_files.program import fields_of
from bench.problems import ProblemSetError, RaceProblem, make
from bench.problems.equilibration import equilibrated
from bench.problems.foreign import Foreign
from bench.problems.proofs import proof, proven
from bench.problems.protocol import SCALINGS, Scaling
from bench.store import Run
from solvers.certificate import NotCertified, verify


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program in each format, and programs without a proof."""
    path = tmp_path_factory.mktemp("programs")
    for source, name in (("drawn.mat", "drawn.mat"), ("drawn.mps", "drawn.QPS"), ("other.mps", "other.mps")):
        shutil.copy(DRAWN / source, path / name)
    eye, zero, one = np.eye(2), np.zeros(2), np.ones(2)
    for name, program in {
        "dense": {"P": eye, "q": -one, "G": np.array([[1.0, 1.0]]), "h": np.array([1.0]), "c": 2.0},
        "indefinite": {"P": np.diag([1.0, -1.0]), "q": zero},
        "infeasible": {"P": eye, "q": zero, "lb": one, "ub": -one},
        "unbounded": {"P": np.diag([1.0, 0.0]), "q": -one, "lb": zero},
        "large": packed_program(Problem(sp.identity(2500, format="csc"), np.zeros(2500))),
    }.items():
        np.savez(path / f"{name}.npz", **program)
    (path / "broken.npz").write_bytes(b"PK and no more")
    (path / "notes.txt").write_text("no program")
    return path


REASONS = {
    "indefinite": "P is not convex",
    "infeasible": "contradict each other",
    "unbounded": "falls without bound",
    "large": "2500 variables with 0 rows are too many",
    "broken": "cannot be read as NPZ",
}
"""Reasons why programs of the folder are left out."""


def problems_of(folder: Path, **options: str) -> tuple[dict[str, RaceProblem], dict[str, str]]:
    """The problems of a folder, and those that are left out."""
    made = make("foreign", options={"folder": str(folder), **options})
    problems = {problem.name: problem for problem in made.problems()}
    assert len(problems) + len(made.left_out) == len(made.names())
    return problems, made.left_out


@pytest.fixture(scope="module")
def foreign(folder: Path) -> dict[str, RaceProblem]:
    return problems_of(folder)[0]


def test_a_saved_problem_with_nan_is_left_out(tmp_path: Path) -> None:
    problem = next(make("paper").problems())
    form = problem.forms["raw"]
    qp = Problem(form.qp.P, form.qp.q, lb=np.where(np.arange(problem.d) == 3, np.nan, form.qp.lb), ub=form.qp.ub)
    for name, spoilt in (("constant", replace(form, c=np.nan)), ("bound", replace(form, qp=qp))):
        replace(problem, forms={"raw": spoilt}).save(tmp_path / f"{name}.npz")
    left_out = problems_of(tmp_path)[1]
    assert "constant.npz: cannot be read as NPZ" in left_out["constant"]  # JSON has no NaN
    assert "nan" in left_out["bound"]


@pytest.mark.parametrize("name", ["drawn.mps", "other.mps"])
def test_scaling_is_by_powers_of_two_and_rounds_nothing(name: str) -> None:
    qp = read(DRAWN / name).qp
    badly = np.exp2(np.arange(qp.q.size) * 3 - 17)
    qp = Problem(
        sp.csc_matrix(sp.diags(badly) @ qp.P @ sp.diags(badly)),
        badly * qp.q,
        qp.G @ sp.diags(badly),
        qp.h,
        qp.A @ sp.diags(badly),
        qp.b,
        qp.lb / badly,
        qp.ub / badly,
    )
    scaled, unit, cost = equilibrated(qp)
    for name, value in fields_of(qp).items():
        np.testing.assert_array_equal(*(np.frexp(dense(each))[0] for each in (value, getattr(scaled, name))))
    np.testing.assert_array_equal(scaled.lb * unit, qp.lb)
    largest = dense(sp.vstack([abs(scaled.P / cost), abs(scaled.G), abs(scaled.A)]).max(axis=0))
    assert np.all((largest > 0.2) & (largest < 5.0))


def test_programs_of_every_format_are_certified_in_both_scalings(foreign: dict[str, RaceProblem]) -> None:
    assert set(foreign) == {"drawn.mat", "drawn.QPS", "other", "dense"}
    for problem in foreign.values():
        raw, scaled = problem.forms["raw"], problem.forms["scaled"]
        for form in (raw, scaled):
            verify(form.qp, form.certificate)
        assert list(scaled.certificate.active()) == list(raw.certificate.active())
        np.testing.assert_array_equal(scaled.to_weights @ np.array(scaled.certificate.x), raw.certificate.x)
        assert problem.validation is None
    by_mat, by_qps, by_hand = (foreign[name].forms["raw"] for name in ("drawn.mat", "drawn.QPS", "dense"))
    assert by_mat.certificate == by_qps.certificate
    assert (by_hand.certificate.value, by_hand.c) == ("-3/4", 2.0)


def test_a_proof_that_takes_too_much_work_is_given_up(tmp_path: Path) -> None:
    np.savez(tmp_path / "long.npz", **packed_program(many_weak_rows()))
    np.savez(tmp_path / "quick.npz", P=np.eye(2), q=np.ones(2))
    why = "no proof within 1e+05 bit operations of exact arithmetic; P is convex, and no active set has been tried"
    assert problems_of(tmp_path, work="1e5")[1] == {"long": why}


@pytest.mark.slow
def test_work_limits_the_proof_and_the_question_of_uniqueness_in_a_race_and_in_the_list(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    np.savez(tmp_path / "weak.npz", **packed_program(many_weak_rows()))
    listed = ("problems", "--set", "foreign", "--folder", tmp_path)
    raced = (
        "race",
        "--folder",
        tmp_path,
        "--budget",
        0.001,
        "--rounds",
        0,
        "--solver",
        "clarabel",
        "--out",
        tmp_path / "results",
    )
    for work, shown, unique in ((1e6, "uniqueness undecided", None), (1e7, "unique", True)):
        assert f" {shown} " in piezobench(*listed, "--verify", "--work", work).stdout
        piezobench.run(*raced, "--work", work, "--name", f"{work:g}")
        problem = Run.open(tmp_path / "results" / f"{work:g}").problem("foreign", "weak")
        assert problem.forms["raw"].certificate.unique == unique
    assert "no proof within 1e+05 bit operations" in piezobench(*raced, "--work", 1e5, "--name", "few").refusal
    assert not (tmp_path / "results" / "few").exists()


def test_proofs_and_refusals_are_cached_by_the_data_and_a_proof_is_verified_when_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    good, other, endless = (
        Problem(np.diag([2.0, curvature]), np.array([-1.0, q]), lb=np.zeros(2))
        for curvature, q in ((3.0, 1.25), (3.0, -1.5), (0.0, -1.25))
    )
    first = proof(good)
    (file,) = tmp_path.rglob("*.json")
    whole = file.read_bytes()
    proof(other)
    (of_other,) = {*tmp_path.rglob("*.json")} - {file}
    with monkeypatch.context() as patch:
        for _ in range(2):
            with pytest.raises(NotCertified, match="falls without bound"):
                proof(endless)
            patch.setattr("bench.problems.proofs.certify", lambda *_, **__: pytest.fail("a proof was searched again"))
        assert proof(good) == first
    for wrong in (of_other.read_bytes(), whole.replace(b'"unique": true', b'"unique": false'), whole[:99], b"[]"):
        file.write_bytes(wrong)
        assert proof(good) == first


ONLY_Q = """
from solvers.direct.daqp import Daqp

class OnlyQ(Daqp):
    name = "only_q"

    def update(self, P=None, q=None):
        assert P is None
        super().update(q=q)
"""


@pytest.fixture(scope="module")
def raced(piezobench: CommandLine, folder: Path) -> tuple[Run, str]:
    """A race on the folder whose proofs cannot be cached, and its output."""
    (own := folder.parent / f"{folder.name}.py").write_text(ONLY_Q)
    options = ("--budget", 0.001, "--rounds", 2, "--schedule", 5, "--lane", "qpsolvers", "--lane", "direct")
    solvers = ("--solver", "daqp", "--solver", "clarabel", "--solver", "box_active_set", "--solver", own)
    words = ("race", "--folder", folder, *solvers, *options, "--out", folder / "results", "--name", "run")
    call = piezobench(*words, XDG_CACHE_HOME=str(own))  # a file instead of a folder
    assert (call.status, call.stderr) == (
        0,
        f"{own}/piezobench: cannot be written (Not a directory), so nothing is kept for the next time\n",
    )
    return Run.open(folder / "results" / "run"), call.said


def test_a_race_without_a_cache_warns_once_leaves_out_programs_without_a_proof_and_lists_the_reasons(
    raced: tuple[Run, str],
) -> None:
    run, shown = raced
    left_out = run.settings["left_out"]["foreign"]
    assert left_out.keys() == REASONS.keys()
    assert "5 of 9 problems" in shown
    pages = [" ".join((run.path / name).read_text().split()) for name in ("report.md", "report.html")]
    for name, reason in left_out.items():
        assert REASONS[name] in reason
        assert f"foreign/{name}: {' '.join(reason.split())[:60]}" in shown
        assert all(f"foreign/{name}" in page for page in pages)


def test_solvers_answer_foreign_problems_or_report_them_as_unsupported(raced: tuple[Run, str]) -> None:
    rows = raced[0].rows().query("is_default and start == 'cold' and timed == 'hot'")
    ours, others = rows[rows.solver == "box_active_set"], rows[rows.solver.isin(["daqp", "clarabel"])]
    assert set(ours.status) == {"unsupported"}
    assert len(others) == 2 * len(ours) * 2  # solvers, lanes
    assert (right(others, Tier.LOW) & ~others.mutates_input).all()


def test_a_p_that_stays_is_not_passed_again_in_any_kind_of_call(raced: tuple[Run, str]) -> None:
    rows = raced[0].rows().query("solver == 'only_q'")
    assert set(rows.timed) >= {"hot", "interleaved", "scheduled"}
    assert set(rows.status) == {"answered"}, rows.message.unique()


def test_test_sets_of_qpbenchmark_are_read_from_their_class(folder: Path, tmp_path: Path) -> None:
    library("qpbenchmark")
    assert in_process("problems", "--set", "foreign", "--folder", folder, "--export", tmp_path).status == 0
    made = make("test_set", options={"test_set": str(tmp_path / "piezobench_foreign.py")})
    found = {problem.name: problem.forms["raw"].certificate.x for problem in made.problems()}
    assert found == {
        f"foreign--{problem.name}--{scaling}": form.certificate.x
        for problem in map(RaceProblem.load, tmp_path.glob("*.npz"))
        for scaling, form in problem.forms.items()
    }
    assert (len(found), made.left_out) == (len(made.names()), {})
    (tmp_path / "mine.py").write_text(
        "from qpbenchmark import Problem\nclass Mine:\n    def __iter__(self):\n        raise OSError('no network')\n"
    )
    with pytest.raises(ProblemSetError, match=r"mine\.py: OSError: no network"):
        list(make("test_set", options={"test_set": str(tmp_path / "mine.py")}).problems())


@pytest.mark.parametrize(
    ("program", "w", "yardstick", "gap"),
    [
        # at x* = (100, 0) the parts of the cost are 1e8 and 2e8
        ({"P": np.diag([2e4, 1.0]), "q": np.array([-2e6, 0.0]), "c": 1e6}, [100.0, 20.0], 2e8, 1e-6),
        ({"P": 2e4 * np.eye(2), "q": np.zeros(2), "A": np.ones((1, 2)), "b": np.zeros(1)}, [1e-6, -1e-6], 1.0, 2e-8),
    ],
)
def test_a_gap_is_relative_to_the_larger_part_of_the_optimal_cost_or_to_its_unit_if_that_is_zero(
    tmp_path: Path, program: dict[str, np.ndarray], w: list[float], yardstick: float, gap: float
) -> None:
    np.savez(tmp_path / "program.npz", **program)
    problem = problems_of(tmp_path)[0]["program"]
    for scaling, form in problem.forms.items():
        assert form.yardstick == pytest.approx(yardstick * form.cost_unit)
        x = np.linalg.solve(dense(form.to_weights), w)
        assert judged(problem, scaling, Outcome(found=True, x=x)).cost_gap == pytest.approx(gap)


def test_saved_problems_keep_their_forms_and_proofs_to_the_last_bit(
    foreign: dict[str, RaceProblem], tmp_path: Path
) -> None:
    paper = next(make("paper").problems())
    saved = {"paper": paper, "maximised": replace(paper, sense=-1.0), **foreign}
    for name, problem in saved.items():
        problem.save(tmp_path / f"{name}.npz")
    loaded = problems_of(tmp_path)[0]
    assert all(same_problem(loaded[name], replace(problem, name=name)) for name, problem in saved.items())
    assert loaded["paper"].set_name == "foreign"


@pytest.mark.parametrize("scaling", SCALINGS)
@pytest.mark.parametrize("name", ["drawn.mat", "dense"])
def test_rows_are_judged_by_the_distance_to_the_nearest_feasible_point(
    foreign: dict[str, RaceProblem], name: str, scaling: Scaling
) -> None:
    form = foreign[name].forms[scaling]
    best, rows = np.array(form.certificate.x), dense(form.qp.G)
    active = rows[np.argmin(form.qp.h - rows @ best)]
    right, wrong = (
        judged(foreign[name], scaling, Outcome(found=True, x=best + violation * active / (active @ active)))
        for violation in (0.0, 1e-3)
    )
    assert (right.status, right.weight_error, np.isnan(right.model_error_percent)) == (Status.ANSWERED, 0.0, True)
    assert (is_right(right, Tier.EXACT), is_right(wrong, Tier.HIGH)) == (True, False)
    assert wrong.violation > 1e-5


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        pytest.param({}, r"holds no program; programs are read from \.npz, \.mat, \.qps, \.mps", id="an empty folder"),
        *(
            ({"folder": str(DRAWN), "work": work}, f"work must be a number of bit operations, not '{work}'")
            for work in ("soon", "nan", "0.5")
        ),
    ],
)
def test_a_folder_without_programs_and_an_invalid_limit_are_refused(
    tmp_path: Path, options: dict[str, str], sentence: str
) -> None:
    with pytest.raises(ProblemSetError, match=sentence):
        make("foreign", options={"folder": str(tmp_path), **options})


def test_every_file_of_a_folder_is_read_or_named(tmp_path: Path) -> None:
    whole, others = DRAWN / "drawn.mps", ("README.md", ".hidden.lp", "piezobench_x.py", "model.lp")
    for name in ("drawn.qps", "one.SIF", *others, "archive.tar.gz", "P.npy"):
        shutil.copy(whole, tmp_path / name)
    (tmp_path / "two.v1.Mps.gz").write_bytes(gzip.compress(whole.read_bytes()))
    (tmp_path / "folder.lp").mkdir()
    found = Foreign(folder=str(tmp_path))
    assert [name for name, _ in found.sources()] == ["drawn", "one", "two.v1"]
    for listed in (found.names(), list(found.problems())):
        assert (len(listed), set(found.left_out)) == (3, {"model.lp", "archive.tar.gz", "P.npy"})
    listed = in_process("problems", "--set", "foreign", "--folder", tmp_path).stdout
    assert "model.lp: is of an unknown format; programs are read from .npz, .mat, .qps, .mps, .sif, .qps.gz" in listed


@pytest.mark.sample(2)
@pytest.mark.parametrize("pause", [0.0, 0.3, 1.0, 0.05, 3.0])
def test_proving_processes_end_with_the_generator_whether_they_start_or_work(pause: float) -> None:
    before = set(multiprocessing.active_children())
    results = proven(time.sleep, [(0.0,)] + 9 * [(3600.0,)])
    with closing(results):
        next(results)
        time.sleep(pause)
    assert set(multiprocessing.active_children()) <= before


def test_an_interrupt_ends_a_running_proof() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # tests in the background ignore it
    try:
        threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            next(proven(time.sleep, [(3600.0,)]))
    finally:
        signal.signal(signal.SIGINT, before)
