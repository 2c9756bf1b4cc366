"""Problems as files: changes are detected, and others can race on them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import qpsolvers
from command_line import CommandLine
from program_files import draw, write_mat
from programs import library

from bench.problems import RaceProblem

Arrays = dict[str, Any]


@pytest.fixture(scope="module")
def exported(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two dense problems and one sparse one with rows, each a set."""
    folder, programs = tmp_path_factory.mktemp("exported"), tmp_path_factory.mktemp("programs")
    write_mat(programs / "drawn.mat", draw(0))
    for words in (("--set", "noise", "--limit", 2), ("--set", "foreign", "--folder", programs)):
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


def lower_value(arrays: Arrays, certificate: dict[str, Any]) -> None:
    certificate["value"] = f"-{certificate['value'].lstrip('-')}1"


def release_bound(arrays: Arrays, certificate: dict[str, Any]) -> None:
    certificate["lower"] = certificate["lower"][1:] or [0]


def perturb_data(arrays: Arrays, certificate: dict[str, Any]) -> None:
    arrays["scaled/q"][3] *= 1.0 + 1e-15


def deny_uniqueness(arrays: Arrays, certificate: dict[str, Any]) -> None:
    certificate["unique"] = not certificate["unique"]


CHANGES = {
    perturb_optimum: "line 7 (answer)",
    lower_value: "line 6 (value)",
    release_bound: "proof line ",
    perturb_data: "line 1 (problem)",
    deny_uniqueness: "line 7 (answer)",
}


@pytest.mark.parametrize("words", [("--set", "noise"), ()])
def test_saved_problems_are_verified_as_they_are(
    piezobench: CommandLine, exported: Path, words: tuple[str, ...]
) -> None:
    call = piezobench.run("problems", *words, "--verify", "--from", exported)
    count = 2 if words else 3
    assert f"{count} of {count} problems are certified in every scaling (100 %): every proof holds." in call.stdout


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
@pytest.mark.parametrize("name", ["noise--noise-none.npz", "foreign--drawn.npz"])
def test_a_saved_problem_in_which_anything_was_changed_is_rejected(
    piezobench: CommandLine, exported: Path, tmp_path: Path, name: str, change: Callable[..., None]
) -> None:
    changed(exported / name, tmp_path / name, change)
    refusal = piezobench("problems", "--verify", "--from", tmp_path).refusal
    assert f"not every proof holds: {name.replace('--', '/').removesuffix('.npz')} (scaled): " in refusal
    assert CHANGES[change] in refusal


def test_a_saved_problem_that_was_changed_is_not_raced_as_a_foreign_one(
    piezobench: CommandLine, exported: Path, tmp_path: Path
) -> None:
    changed(exported / "noise--noise-none.npz", tmp_path / "changed.npz", perturb_optimum)
    call = piezobench("problems", "--set", "foreign", "--folder", tmp_path, "--verify")
    assert "there is no certified problem" in call.refusal
    assert "Not certified and therefore not raced: changed: proof line 7" in call.stdout


def test_a_file_without_a_certificate_and_a_damaged_one_are_reported(
    piezobench: CommandLine, exported: Path, tmp_path: Path
) -> None:
    np.savez(tmp_path / "bare.npz", P=np.eye(2), q=np.ones(2))
    assert "bare.npz: holds no array" in piezobench("problems", "--verify", "--from", tmp_path).refusal
    whole = (exported / "noise--noise-none.npz").read_bytes()
    (tmp_path / "bare.npz").write_bytes(whole[: len(whole) // 2])
    assert "bare.npz: cannot be read as NPZ" in piezobench("problems", "--verify", "--from", tmp_path).refusal


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
        value = 0.5 * answer.x @ (problem.P @ answer.x) + problem.q @ answer.x
        assert value == pytest.approx(ours.certificate.value_rounded, rel=1e-6)
        assert test_set.get_problem(problem.name).q.tobytes() == ours.qp.q.tobytes()
