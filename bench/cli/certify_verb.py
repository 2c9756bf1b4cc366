"""The verb ``certify``: proves the optimum of a program in a file, as a document for others, or judges the answers of
solvers to a problem set."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from qpsolvers import Problem

from bench.cli.options import installed, positive, refuse
from bench.problem_files import ProblemFileError, read
from bench.problem_files.program import about, require
from bench.problems import make
from bench.problems.certifying import ProverLost, prove, require_size
from bench.problems.proofs import start
from bench.processes.forked_child import ForkedChild
from bench.processes.solver_child import entry_of_file
from bench.report.console import AsJson, check_writable, print_result, progress_bar
from bench.solver_check import LEVELS, checked, checked_settings, row, worst
from piezo_model.atomic_file import write_text
from solvers import find
from solvers.arrays import Vector
from solvers.certificate import NotCertified, certify
from solvers.certificate_document import document
from solvers.exact.linear_algebra import WORK, OutOfWork
from solvers.registry import Entry, from_file

NO_PROOF = 3
"""Exit status if the work allowed does not suffice for a proof."""
WORST = 3
"""Number of programs that are named for a solver whose answers are not right."""
SHOWN = 12
"""Most variables whose values are printed."""


def certify_verb(
    context: typer.Context,
    problem: Annotated[Path | None, typer.Argument(help="Program in NPZ, MAT, QPS, MPS or SIF.")] = None,
    answer: Annotated[Path | None, typer.Option(help="NPY file with an answer to judge.")] = None,
    out: Annotated[Path | None, typer.Option(help="JSON file for the certificate.")] = None,
    problem_set: Annotated[
        str | None, typer.Option("--set", help="Judge the answers of solvers to this problem set, such as boxes.")
    ] = None,
    solver: Annotated[
        list[str] | None, typer.Option(help="With --set: a solver's name, or your own Python file; repeatable.")
    ] = None,
    tolerance: Annotated[
        float, typer.Option(callback=positive, help="With --set: largest relative error of a right answer.")
    ] = LEVELS[0],
    work: Annotated[float, typer.Option(callback=positive, help="Most bit operations of a proof.")] = WORK,
    as_json: AsJson = False,
) -> None:
    """Prove the optimum of a program in exact arithmetic, and judge an answer; or judge solvers on a problem set.

    The certificate can be checked without piezobench: examples/check_certificate.py. Exit status 3 means that there is
    no proof within --work, and 1 that a solver has an answer of --set that is not right.
    """
    if problem_set is not None:
        refuse(context, ("problem", "answer", "out", "work"), "is for one program, without --set")
        raise typer.Exit(_judge_solvers(problem_set, solver or [], tolerance, as_json))
    refuse(context, ("solver", "tolerance"), "needs --set")
    if problem is None:
        raise typer.BadParameter("name a program's file, or a problem set with --set", param_hint="PROBLEM")
    if out is not None:
        check_writable(out, others=[each for each in (problem, answer) if each is not None])
    program = read(problem)
    x = None if answer is None else _answer(answer, program.qp.q.size)
    try:
        with ForkedChild() as child:
            found = prove(child, certified, program.qp, program.constant, x, work)
    except OutOfWork as error:
        print(f"piezobench certify: {problem}: {error}", file=sys.stderr)
        raise typer.Exit(NO_PROOF) from None
    except (NotCertified, ProverLost) as error:
        raise ProblemFileError(f"{problem}: {error}") from None
    if out is not None:
        write_text(out, json.dumps(found))
    print_result(found, [*_sentences(found), f"Certificate: {out}" if out else ""], as_json)


def _judge_solvers(problem_set: str, names: Sequence[str], tolerance: float, as_json: bool) -> int:
    """Print how near the answers of each solver come, and the worst of each; returns the exit status."""
    if not names:
        raise typer.BadParameter("name a solver, or your own Python file", param_hint="--solver")
    entries = [entry_of_file(name, from_file) if name.endswith(".py") else _known(name) for name in names]
    problems = list(make(problem_set).problems())
    rows, lines, results, wrong = [], [], [], 0
    for entry in entries:
        right = False
        for setting, finest in checked_settings(entry).items():
            with progress_bar() as progress:
                answers = checked(entry, finest, problems, progress)
            counted = row(answers)
            rows.append(
                (entry.name, setting, *(f"{n:.1e}" if isinstance(n, float) else str(n) for n in counted.values()))
            )
            results.append({"solver": entry.name, "setting": setting, **counted, "answers": list(map(asdict, answers))})
            missed = [each for each in answers if each.is_missed(tolerance)]
            right |= not missed and any(each.is_supported for each in answers)
        if not right:
            wrong += 1
            ends = [f"{each.problem} ({each.verdict()})" for each in worst(missed, WORST)]
            lines.append(
                f"{entry.name}, {setting}: not right within {tolerance:g} on {len(missed)} of {len(answers)}, such as "
                f"{'; '.join(ends)}."
                if missed
                else f"{entry.name}: takes none of these programs."
            )
    document = {"problems": len(problems), "solvers": results}
    print_result(document, lines, as_json, (("solver", "setting", *row([])), rows, 2))
    return int(wrong > 0)


def _known(name: str) -> Entry:
    installed(name)
    return find(name)


def certified(qp: Problem, constant: float, answer: Vector | None, work: float) -> dict[str, Any]:
    """The certificate of a program as a document, from the start that a library finds."""
    require_size(qp)
    return document(qp, certify(qp, start(qp), work=work), constant=constant, answer=answer, work=work)


def _answer(path: Path, size: int) -> Vector:
    """The answer (size,) in a file; ProblemFileError for anything else."""
    with about(path):
        try:
            x = np.load(path, allow_pickle=False)
        except (ValueError, EOFError) as error:
            raise ValueError(f"cannot be read as NPY: {error}") from None
        require(isinstance(x, np.ndarray) and x.dtype.kind in "iuf", "holds no array of real numbers")
        require(x.shape == (size,), f"is of shape {x.shape} and not ({size},), one number for each variable")
        require(np.isfinite(x).all(), "has an element that is not a finite number")
        return np.asarray(x, dtype=np.float64)


def _sentences(found: dict[str, Any]) -> list[str]:
    optimum, rounded = found["optimum"], found["rounded"]
    value = f"The least cost is {rounded['value']}"
    if len(optimum["value"]) <= len(rounded["value"]):
        value += f", exactly {optimum['value']}"
    if float.fromhex(found["shift"]):
        value += f", of P + {float.fromhex(found['shift']):.0e} I, since P is indefinite by rounding"
    active = [f"{name} {', '.join(map(str, tight))}" for name, tight in found["active"].items() if tight]
    unique = {"yes": "is the only one", "no": "is not the only one", "undecided": "may not be the only one"}
    lines = [
        f"{value}; this is proved in exact arithmetic.",
        f"x* = ({', '.join(rounded['x'])})." if len(rounded["x"]) <= SHOWN else "",
        f"x* {unique[found['unique']]}; tight at x*: {'; '.join(active) or 'no constraint'}.",
    ]
    if "answer" in found:
        gap, violation, distance = (float(Fraction(found["answer"][key])) for key in ("gap", "violation", "distance"))
        lines.append(
            f"The answer breaks the constraints by {violation:.3g} at most; the feasible point nearest to it costs "
            f"{gap:.3g} more than the optimum. Its largest distance from x* in one variable is {distance:.3g}."
        )
    return lines
