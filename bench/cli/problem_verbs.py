"""Verbs for problems: ``problems`` lists the sets and their problems, checks their proofs, and writes them to files;
``certify`` proves the optimum of a program in a file, as a document for others."""

import json
import sys
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from qpsolvers import Problem

from bench.cli import UNDECIDED
from bench.cli.options import (
    SET_OPTIONS,
    AsJson,
    Seed,
    check_writable,
    grouped,
    positive,
    refuse,
    set_options,
)
from bench.problem_files import ProblemFileError, npz, qpbenchmark_set, read
from bench.problems import ProblemSetError, RaceProblem, all_sets, check_options, make
from bench.problems.proofs import isolated, require_size, start
from bench.report.console import print_result, progress_bar
from bench.report.words import by_heading
from piezo_model.atomic_file import write_text
from piezo_model.checks import check
from solvers import certificate, certificate_document
from solvers.arrays import Vector
from solvers.exact.linear_algebra import WORK, OutOfWork, nearest_double

HEADINGS = ("problem", "optimum", "point", "variables", "rows", "condition", "gaps are relative to", "proofs")
SHOWN = 12
"""Most variables whose values are printed."""


@grouped("options", SET_OPTIONS, set_options)
def problems_verb(
    context: typer.Context,
    options: dict[str, str],
    problem_set: Annotated[
        str | None, typer.Option("--set", metavar="SET", help="List the problems of this set.")
    ] = None,
    verify: Annotated[bool, typer.Option("--verify", help="Check every proof again in exact arithmetic.")] = False,
    export: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Folder to write the problems to, as NPZ and as a test set of qpbenchmark."
        ),
    ] = None,
    limit: Annotated[int | None, typer.Option(metavar="N", min=1, help="Number of problems; all by default.")] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """List the problem sets, or the problems of one set.

    It can also check every proof again and write the problems to files.
    """
    if problem_set is None:
        refuse(context, ("verify", "export", "limit", "seed", *SET_OPTIONS), "needs problems; name a --set")
        sets = [
            (
                name,
                f"needs {', '.join(f'--{option}' for option in cls.needs)}".replace("_", "-")
                if cls.needs
                else str(len(cls().names())),
                cls.description,
            )
            for name, cls in all_sets().items()
        ]
        of_sets = ("set", "problems", "what it is for")
        print_result(by_heading(of_sets, sets), as_json, (of_sets, sets, 3))
        return
    check_options([problem_set], options)
    made = make(problem_set, seed, options)
    total, left_out = len(made.names()), made.left_out
    if export is not None:
        export.mkdir(parents=True, exist_ok=True)
    rows, failures, sparse = list[tuple[str, ...]](), list[str](), False
    with progress_bar() as progress:
        for done, problem in enumerate(islice(made.problems(), limit)):
            name = f"{problem_set}/{problem.name}"
            progress(name, done, min(total, limit or total))
            wrong = problem.wrong_proofs() if verify else {}
            failures += [f"{name} ({scaling}): {why}" for scaling, why in wrong.items()]
            rows.append((*_described(problem), *(("; ".join(wrong.values()) or "holds",) if verify else ())))
            if export is not None:
                problem.save(export / f"{problem_set}--{problem.name}.npz")
                sparse |= not isinstance(next(iter(problem.forms.values())).qp.P, np.ndarray)
    test_sets = [qpbenchmark_set.write_test_set(export, problem_set, sparse)] if export and rows else []
    headings, count = HEADINGS if verify else HEADINGS[:-1], len(rows) + len(left_out)
    lines = [f"Not certified and therefore not raced: {name}: {why}" for name, why in left_out.items()]
    lines += [f"Test set of qpbenchmark: {path}" for path in test_sets]
    if verify and rows and not failures:
        lines.append(
            f"{len(rows)} of {count} problems are certified in every scaling ({100 * len(rows) / count:.0f} %): every "
            "proof holds."
        )
    print_result(
        {
            "problems": by_heading(headings, rows),
            "left_out": dict(left_out),
            "test_sets": test_sets,
            "failures": failures,
        },
        as_json,
        (headings, rows, 2),
        *lines,
    )
    check(rows, f"there is no certified problem in {problem_set}", ProblemSetError)
    more = f" and {len(failures) - 1} more" if len(failures) > 1 else ""
    check(not failures, f"not every proof holds: {''.join(failures[:1])}{more}", ProblemSetError)


def _described(problem: RaceProblem) -> tuple[str, ...]:
    form = next(iter(problem.forms.values()))
    rows = sum(side.size for side in (form.qp.h, form.qp.b) if side is not None)
    condition = f"{form.condition:.1e}" if form.condition < float("inf") else "singular"
    point = {True: "unique", False: "not unique", None: "uniqueness undecided"}[form.certificate.unique]
    if shift := form.certificate.convexity_shift:
        point = f"of P + {shift:.0e} I, since rounding left P indefinite"
    numbers = (str(problem.d), str(rows), condition, f"{form.yardstick:.3g}")
    return problem.name, repr(problem.optimum), point, *numbers


def certify_verb(
    problem: Annotated[Path, typer.Argument(help="Program in NPZ, MAT, QPS, MPS or SIF.")],
    answer: Annotated[Path | None, typer.Option(metavar="FILE.npy", help="NPY file with an answer to judge.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.json", help="JSON file for the certificate.")] = None,
    work: Annotated[
        float,
        typer.Option(
            metavar="OPERATIONS", show_default=f"{WORK:.0e}", callback=positive, help="Most bit operations of a proof."
        ),
    ] = WORK,
    as_json: AsJson = False,
) -> None:
    """Prove the optimum of a program in exact arithmetic, and judge an answer.

    The certificate can be checked without piezobench: examples/check_certificate.py. Exit status 4 means that there is
    no proof within --work.
    """
    check_writable(out, others=[problem, answer])
    program = read(problem)
    x = None if answer is None else npz.read_answer(answer, program.qp.q.size)
    try:
        proof = isolated(certified, program.qp, program.constant, x, work)
    except OutOfWork as error:
        print(f"piezobench certify: {problem}: {error}", file=sys.stderr)
        raise typer.Exit(UNDECIDED) from None
    except certificate.NotCertified as error:
        raise ProblemFileError(f"{problem}: {error}") from None
    if out is not None:
        write_text(out, json.dumps(proof))
    if program.sense < 0.0:
        proof["objective"] = {"sense": "max", "value": str(-Fraction(proof["optimum"]["value"]))}
    print_result(proof, as_json, *_sentences(proof), f"Certificate: {out}" if out else "")


def certified(qp: Problem, constant: float, answer: Vector | None, work: float) -> dict[str, Any]:
    """The certificate of a program as a document, from the start that a library finds."""
    require_size(qp)
    return certificate_document.document(
        qp, certificate.certify(qp, start(qp), work=work), constant=constant, answer=answer, work=work
    )


def _sentences(proof: dict[str, Any]) -> list[str]:
    optimum, rounded = proof["optimum"], proof["rounded"]
    shift = float.fromhex(proof["shift"])
    exactly = f", exactly {optimum['value']}" if len(optimum["value"]) <= len(rounded["value"]) else ""
    shifted = f", of P + {shift:.0e} I, since P is indefinite by rounding" if shift else ""
    active = [f"{name} {', '.join(map(str, tight))}" for name, tight in proof["active"].items() if tight]
    unique = {"yes": "is the only one", "no": "is not the only one", "undecided": "may not be the only one"}
    beginning = "The least cost"
    if "objective" in proof:
        beginning = (
            f"The objective is maximised, and its greatest value is {-float(rounded['value'])!r}. "
            "The least cost of its negative"
        )
    lines = [
        f"{beginning} is {rounded['value']}{exactly}{shifted}; this is proved in exact arithmetic.",
        f"x* = ({', '.join(rounded['x'])})." if len(rounded["x"]) <= SHOWN else "",
        f"x* {unique[proof['unique']]}; tight at x*: {'; '.join(active) or 'no constraint'}.",
    ]
    if "answer" in proof:
        gap, violation, distance = (
            nearest_double(Fraction(proof["answer"][key])) for key in ("gap", "violation", "distance")
        )
        lines.append(
            f"The answer breaks the constraints by {violation:.3g} at most; the feasible point nearest to it costs "
            f"{gap:.3g} more than the optimum. Its largest distance from x* in one variable is {distance:.3g}."
        )
    return lines
