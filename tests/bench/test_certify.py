"""``piezobench certify``, and the check of its certificates by a script that knows nothing of the package."""

import hashlib
import json
import runpy
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import slowed_solver
from box_programs import many_weak_rows
from command_line import CommandLine, in_process, python, run_example
from hostile_files import spoiled
from qpsolvers import Problem
from recording_files import text_file
from scipy.sparse import csc_matrix

from bench.problem_files import ReadProgram, read
from bench.problem_files.npz import packed_program
from bench.problems.foreign import Boxes
from bench.store import Run
from solvers.certificate import certify
from solvers.certificate_document import document

CHECKER = Path(__file__).parents[2] / "examples/check_certificate.py"
RNG = np.random.default_rng(20)


def gram(rows: int, d: int) -> np.ndarray:
    M = RNG.integers(-9, 10, size=(rows, d)) / 8.0
    return M.T @ M


BOX = {"lb": np.zeros(6), "ub": np.full(6, 2.0)}
PROGRAMS = {
    "sparse": Problem(csc_matrix(gram(6, 4)), np.ones(4), csc_matrix(np.ones((1, 4))), np.full(1, -2.0)),
    "one variable": Problem(np.eye(1), np.array([-3.0]), lb=np.zeros(1), ub=np.ones(1)),
    "box": Problem(gram(9, 6), RNG.normal(size=6), **BOX),
    "singular": Problem(gram(3, 6), gram(3, 6) @ RNG.normal(size=6), **BOX),
    "no curvature": Problem(np.zeros((3, 3)), np.array([1.0, 0.0, 0.0]), lb=np.zeros(3), ub=np.ones(3)),
    "indefinite by rounding": Problem(
        np.array([[1.0, 1.0], [1.0, 1.0 - 2**-53]]), np.array([-1.0, 1.0]), lb=np.zeros(2)
    ),
    "rows and equalities": Problem(
        gram(6, 4), RNG.normal(size=4), RNG.normal(size=(5, 4)), np.ones(5), np.ones((1, 4)), np.zeros(1)
    ),
    "weak rows": many_weak_rows(),
}


def checked(certificate: Path, *problem: Path, refused: bool = False) -> str:
    """What the checker prints in a process that finds no installed package."""
    done = python("-I", "-S", CHECKER, certificate, *problem, status=int(refused))
    return done.stderr if refused else done.stdout


def saved(problem: Problem, folder: Path) -> Path:
    """A file of qpsolvers, or of sparse matrices in compressed columns."""
    path = folder / "problem.npz"
    if isinstance(problem.P, np.ndarray):
        problem.save(str(path))
    else:
        np.savez(path, **packed_program(problem))
    return path


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", PROGRAMS)
def test_a_certificate_is_confirmed_by_a_script_without_any_package(tmp_path: Path, name: str) -> None:
    file = saved(PROGRAMS[name], tmp_path)
    np.save(tmp_path / "x.npy", RNG.normal(size=PROGRAMS[name].q.size))
    in_process("certify", file, "--answer", tmp_path / "x.npy", "--out", tmp_path / "certificate.json")
    assert checked(tmp_path / "certificate.json", file).startswith("every number holds")


def test_the_sentences_state_the_optimum_and_the_judgement_of_an_answer(tmp_path: Path) -> None:
    np.savez(tmp_path / "p.npz", P=np.eye(2), q=np.array([-3.0, 1.0]), lb=np.zeros(2), ub=np.full(2, 2.0), c=1.5)
    np.save(tmp_path / "x.npy", np.array([1.5, -0.25]))
    said = in_process("certify", tmp_path / "p.npz", "--answer", tmp_path / "x.npy").stdout
    assert "The least cost is -2.5, exactly -5/2; this is proved in exact arithmetic." in said
    assert "x* is the only one; tight at x*: lb 1; ub 0." in said
    assert "breaks the constraints by 0.25 at most; the feasible point nearest to it costs 0.625 more" in said


GREATEST = """NAME
OBJSENSE
 MAX
ROWS
 N C
COLUMNS
 X C 4.0
RHS
 RHS C -3.0
BOUNDS
 UP B X 9.0
QUADOBJ
 X X -2.0
ENDATA
"""


def test_the_greatest_value_of_an_objective_that_is_maximised_is_stated_as_in_the_list_of_problems(
    tmp_path: Path,
) -> None:
    (tmp_path / "greatest.qps").write_text(GREATEST)
    said = in_process("certify", tmp_path / "greatest.qps").stdout
    assert "its greatest value is 7.0. The least cost of its negative is -7.0, exactly -7; this is proved" in said
    assert json.loads(in_process("certify", tmp_path / "greatest.qps", "--json").stdout)["objective"]["value"] == "7"
    listed = json.loads(in_process("problems", "--set", "foreign", "--folder", tmp_path, "--json").stdout)
    assert [problem["optimum"] for problem in listed["problems"]] == ["7.0"]


def leaves(value: object, path: tuple[object, ...] = ()) -> Iterator[tuple[tuple[object, ...], object]]:
    """Every text with a digit in a document, with the keys that lead to it."""
    if isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(each, (*path, key))
    elif any(c.isdigit() for c in str(value)):
        yield path, value


def number(text: str) -> float | Fraction:
    """What a text of a document stands for."""
    return float.fromhex(text) if "x" in str(text) else Fraction(text)


def with_one_digit_changed(text: str | int) -> str | int:
    """Another number, or another word, by one digit at a random place."""
    if isinstance(text, int):
        return text + 1
    while True:
        i = int(RNG.choice([i for i, c in enumerate(text) if c.isdigit()]))
        changed = f"{text[:i]}{(int(text[i]) + 1) % 10}{text[i + 1 :]}"
        if "version" in text or ("0x" in changed and number(changed) != number(text)):
            return changed
        if "x" not in text and changed[-1:] != "0" and number(changed) != number(text):
            return changed


@pytest.mark.parametrize("name", ["box", "no curvature", "indefinite by rounding", "rows and equalities", "sparse"])
def test_a_certificate_with_any_number_changed_in_one_digit_is_refused(tmp_path: Path, name: str) -> None:
    program = PROGRAMS[name]
    file, main = saved(program, tmp_path), runpy.run_path(str(CHECKER))["main"]
    found = document(program, certify(program, np.zeros(program.q.size)), answer=RNG.normal(size=program.q.size))
    copy = text_file(tmp_path, json.dumps(found), name="changed.json")
    main(str(copy), str(file))
    # another second optimum may be one too, and then the statement is still true
    numbers = [(path, text) for path, text in leaves(found) if path[0] != "second_optimum"]
    assert len(numbers) > 30
    for path, text in numbers:
        copy.write_bytes(*spoiled(found, path, json.dumps(with_one_digit_changed(text))))
        with pytest.raises(SystemExit, match=r"^refused: "):
            main(str(copy), str(file))


def test_a_certificate_of_other_data_is_refused_for_one_bit(tmp_path: Path) -> None:
    program = PROGRAMS["box"]
    (tmp_path / "c.json").write_text(json.dumps(document(program, certify(program, np.zeros(6)))))
    np.savez(
        tmp_path / "other.npz",
        P=program.P,
        q=np.where(np.arange(6) == 3, np.nextafter(program.q, np.inf), program.q),
        **BOX,
    )
    assert checked(tmp_path / "c.json", tmp_path / "other.npz", refused=True).startswith(
        "refused: q of the certificate is not that of"
    )


@pytest.mark.parametrize(
    ("P", "q", "shift", "unique", "why"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], [0.0, 0.0], 0.0, "yes", "P + δI is not positive semidefinite"),
        ([[1.0, 2.0], [2.0, 1.0]], [0.0, 0.0], 2.0, "yes", "δ is more than rounding makes of P"),
        ([[1.0, 0.0], [0.0, 1.0]], [0.0, 0.0], -0.5, "yes", "δ is more than rounding makes of P"),
        ([[1.0, 0.0], [0.0, 0.0]], [-1.0, -(2.0**-38)], 2.0**-41, "yes", "δ decides the optimum"),
        ([[1.0, 0.0], [0.0, 1.0]], [0.0, 0.0], 0.0, "yes, surely", "whether x* is unique is stated in another word"),
    ],
)
def test_a_stationary_point_of_a_program_that_is_convex_by_its_shift_alone_or_not_at_all_is_refused_by_the_script(
    tmp_path: Path, P: list[list[float]], q: list[float], shift: float, unique: str, why: str
) -> None:
    program = Problem(np.array(P), np.array(q))
    proof = replace(certify(Problem(np.eye(2), program.q), np.zeros(2)), convexity_shift=shift)
    (tmp_path / "c.json").write_text(json.dumps(document(program, proof) | {"unique": unique}))
    assert checked(tmp_path / "c.json", refused=True) == f"refused: {why}\n"


def test_the_problem_that_a_race_has_stored_is_certified_in_original_units(tmp_path: Path) -> None:
    stored = Path(__file__).parents[2] / "results/reference/problems/measured--dbo.npz"
    in_process("certify", stored, "--out", tmp_path / "c.json")
    assert checked(tmp_path / "c.json", stored)


EYE, ONES = np.eye(2), np.ones(2)


@pytest.mark.parametrize(
    ("fields", "answer", "why"),
    [
        ({"P": -EYE, "q": ONES}, ONES, "p.npz: P is not convex"),
        ({"P": 0.0 * EYE, "q": ONES}, ONES, "p.npz: the cost falls without bound"),
        ({"P": EYE, "q": ONES, "lb": ONES, "ub": 0.0 * ONES}, ONES, "p.npz: the constraints contradict each other"),
        ({"P": EYE, "q": ONES}, np.zeros(3), "x.npy: expected shape (2,), one number for each variable, got (3,)"),
        ({"P": EYE, "q": ONES}, np.array([np.nan, 0.0]), "x.npy: has an element that is not a finite number"),
        ({"P": EYE, "q": ONES}, np.array(["a", "b"]), "x.npy: holds no array of real numbers"),
    ],
)
def test_a_program_without_an_optimum_or_an_answer_that_is_none_is_refused_by_its_file_and_nothing_is_written(
    tmp_path: Path, fields: dict[str, np.ndarray], answer: np.ndarray, why: str
) -> None:
    np.savez(tmp_path / "p.npz", **fields)
    np.save(tmp_path / "x.npy", answer)
    assert why in in_process("certify", "p.npz", "--answer", "x.npy", "--out", "c.json", folder=tmp_path).refusal
    assert not (tmp_path / "c.json").exists()


def test_a_proof_that_takes_too_much_work_ends_with_status_4_and_says_how_far_it_came(tmp_path: Path) -> None:
    ended = in_process(
        "certify", saved(PROGRAMS["rows and equalities"], tmp_path), "--work", 100, "--out", tmp_path / "c.json"
    )
    assert (ended.status, (tmp_path / "c.json").exists()) == (4, False)
    assert "no proof within 1e+02 bit operations of exact arithmetic; P is convex, and no active set" in ended.stderr


def test_the_programs_of_the_public_set_have_the_same_bits_everywhere() -> None:
    digest = hashlib.sha256()
    for name, source in Boxes().sources():
        program = source()
        assert isinstance(program, ReadProgram)
        qp = program.qp
        arrays = (np.ascontiguousarray(array).tobytes() for array in (qp.P, qp.q, qp.lb, qp.ub))
        digest.update(b"".join([name.encode(), *arrays]))
    assert digest.hexdigest() == "7a2c23039d26cb811a2b7a87a32ac9503ea0d43a463dbb876ed684435c50b63b"


@pytest.mark.slow
def test_the_published_set_holds_every_program_in_every_format_with_a_certificate_that_is_confirmed(
    tmp_path: Path,
) -> None:
    run_example("problem_sets/make_boxes.py", "--out", tmp_path / "set")
    arrays = np.load(tmp_path / "set/boxes.npz")
    main, names = runpy.run_path(str(CHECKER))["main"], sorted({key.split("/")[0] for key in arrays})
    assert len(names) == 200
    for name in names:
        qp = read(tmp_path / f"set/{name}.qps").qp
        np.testing.assert_array_equal(qp.P.toarray(), arrays[f"{name}/P"])
        np.testing.assert_array_equal(qp.q, arrays[f"{name}/q"])
    for name in names[::10]:
        np.savez(tmp_path / "p.npz", **{field: arrays[f"{name}/{field}"] for field in ("P", "q", "lb", "ub")})
        main(str(tmp_path / f"set/{name}.json"), str(tmp_path / "p.npz"))


@pytest.mark.slow
def test_on_the_public_set_the_exact_solver_is_right_everywhere_and_a_wrong_one_of_ones_own_ends_the_race_with_1(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    solvers = ("--solver", "box_active_set", "--solver", slowed_solver.write(tmp_path, 1.0))
    words = ("--set", "boxes", "--lane", "kernel", "--scaling", "raw", "--budget", 0, "--rounds", 0)
    ended = piezobench("race", *words, *solvers, "--out", tmp_path, "--name", "run")
    assert (ended.status, "Wrong: slowed (direct) " in ended.said) == (1, True)
    rows = Run(tmp_path / "run").rows().query("solver == 'box_active_set' and timed == 'hot'")
    assert rows.problem.nunique() == 200
    assert rows[["cost_gap", "violation"]].max(axis=None) < 1e-9
