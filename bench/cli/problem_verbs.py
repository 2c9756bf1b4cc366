"""The verb ``problems``: lists the problem sets and their problems, checks their proofs, and writes them to files."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from bench.cli.options import SET_OPTIONS, Seed, grouped, refuse, set_options
from bench.problem_files.qpbenchmark_set import write_test_set
from bench.problems import ProblemSet, ProblemSetError, RaceProblem, all_sets, check_options, make
from bench.report.console import AsJson, print_result, progress_bar, show_table
from bench.report.words import by_heading
from solvers.certificate import Certificate

HEADINGS = ("problem", "optimum", "point", "variables", "rows", "condition", "gaps are relative to", "proofs")
OPTIONS = {name: option for name, option in SET_OPTIONS.items() if name not in ("from_s", "to_s")}
"""Options of the sets; ``--from`` is another one here."""


@grouped("options", OPTIONS, set_options)
def problems_verb(
    context: typer.Context,
    options: dict[str, str],
    problem_set: Annotated[str | None, typer.Option("--set", help="List the problems of this set.")] = None,
    verify: Annotated[bool, typer.Option("--verify", help="Check every proof again in exact arithmetic.")] = False,
    source: Annotated[
        Path | None, typer.Option("--from", help="Folder with saved problems, instead of making them.")
    ] = None,
    export: Annotated[
        Path | None, typer.Option(help="Folder to write the problems to, as NPZ and as a test set of qpbenchmark.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Number of problems; all by default.")] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """List the problem sets, or the problems of one set.

    It can also check every proof again and write the problems to files.
    """
    if problem_set is None and source is None:
        needs_problems = ("verify", "export", "limit", "seed", *OPTIONS)
        refuse(context, needs_problems, "needs problems; name a --set, or a folder with --from")
        sets = [(name, _count(cls), cls.description) for name, cls in sorted(all_sets().items())]
        show_table(("set", "problems", "what it is for"), sets, 3, as_json)
        return
    if source is not None:
        refuse(context, ("seed", *OPTIONS), "is for making problems, and those in the folder --from are made")
    elif problem_set is not None:
        check_options([problem_set], options)
    problems, left_out, total = _problems(problem_set, source, seed, options)
    if export is not None:
        export.mkdir(parents=True, exist_ok=True)
    rows, failures, exported = list[tuple[str, ...]](), list[str](), defaultdict[str, list[bool]](list)
    with progress_bar() as progress:
        for done, problem in enumerate(islice(problems, limit)):
            name = f"{problem.set_name}/{problem.name}"
            progress(name, done, min(total, limit or total))
            wrong = problem.wrong_proofs() if verify else {}
            failures += [f"{name} ({scaling}): {why}" for scaling, why in wrong.items()]
            rows.append((*_described(problem), *(("; ".join(wrong.values()) or "holds",) if verify else ())))
            if export is not None:
                problem.save(export / f"{problem.set_name}--{problem.name}.npz")
                exported[problem.set_name].append(not isinstance(next(iter(problem.forms.values())).qp.P, np.ndarray))
    test_sets = [write_test_set(export, name, any(sparse)) for name, sparse in exported.items()] if export else []
    headings, count = HEADINGS if verify else HEADINGS[:-1], len(rows) + len(left_out)
    lines = [f"Not certified and therefore not raced: {name}: {why}" for name, why in left_out.items()]
    lines += [f"Test set of qpbenchmark: {path}" for path in test_sets]
    if verify and rows and not failures:
        share = 100.0 * len(rows) / count
        lines.append(
            f"{len(rows)} of {count} problems are certified in every scaling ({share:.0f} %): every proof holds."
        )
    document = {"problems": by_heading(headings, rows), "left_out": dict(left_out), "test_sets": test_sets}
    print_result({**document, "failures": failures}, lines, as_json, (headings, rows, 2))
    if not rows:
        raise ProblemSetError(f"there is no certified problem in {source or problem_set}")
    if failures:
        more = f" and {len(failures) - 1} more" if len(failures) > 1 else ""
        raise ProblemSetError(f"not every proof holds: {failures[0]}{more}")


def _count(cls: type[ProblemSet]) -> str:
    return (
        "needs " + ", ".join(f"--{option.replace('_', '-')}" for option in cls.needs)
        if cls.needs
        else str(len(cls().names()))
    )


def _problems(
    problem_set: str | None, source: Path | None, seed: int, options: Mapping[str, str]
) -> tuple[Iterator[RaceProblem], Mapping[str, str], int]:
    """The problems, those left out with the reason (complete after the last problem), and the largest count."""
    if source is None:
        made = make(str(problem_set), seed, options)
        return made.problems(), made.left_out, len(made.names())
    if not source.is_dir():
        raise ProblemSetError(f"{source}: is not a folder")
    files = sorted(source.glob("*.npz"))
    loaded = (RaceProblem.load(path) for path in files)
    return (problem for problem in loaded if problem_set in (None, problem.set_name)), {}, len(files)


def _described(problem: RaceProblem) -> tuple[str, ...]:
    form = next(iter(problem.forms.values()))
    rows = sum(side.size for side in (form.qp.h, form.qp.b) if side is not None)
    condition = f"{form.condition:.1e}" if form.condition < float("inf") else "singular"
    optimum, point = repr(problem.optimum), _point(form.certificate)
    return problem.name, optimum, point, str(problem.d), str(rows), condition, f"{form.yardstick:.3g}"


def _point(certificate: Certificate) -> str:
    if certificate.convexity_shift:
        return f"of P + {certificate.convexity_shift:.0e} I, since rounding left P indefinite"
    return {True: "unique", False: "not unique", None: "uniqueness undecided"}[certificate.unique]
