"""The verb ``problems``: what the problem sets hold, whether every proof holds, and the problems as files."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from bench.cli.options import (
    FILE,
    READING_OPTIONS,
    Input,
    Output,
    Time,
    as_text,
    is_given,
    reads_a_recording,
    refuse,
)
from bench.problem_files.qpbenchmark_set import write_test_set
from bench.problems import ProblemSet, ProblemSetError, RaceProblem, all_sets, check_options, make
from bench.report.console import AsJson, console, print_json, print_table, progress_bar, records
from solvers.certificate import WORK, Certificate, NotCertified, verify


@reads_a_recording
def problems_verb(
    context: typer.Context,
    reading: dict[str, Any],
    problem_set: Annotated[str | None, typer.Option("--set", help="List the problems of this set.")] = None,
    verify: Annotated[bool, typer.Option("--verify", help="Replay every proof in exact arithmetic.")] = False,
    source: Annotated[
        Path | None, typer.Option("--from", help="Folder with saved problems, in place of making them.")
    ] = None,
    export: Annotated[
        Path | None, typer.Option(help="Folder for the problems as NPZ and a test set of qpbenchmark.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Number of problems; all by default.")] = None,
    seed: Annotated[int, typer.Option(help="Everything random follows from it.")] = 0,
    recording: Annotated[Path | None, typer.Option(help=f"For the set recorded. {FILE}")] = None,
    time: Time = None,
    input: Input = None,
    output: Output = None,
    folder: Annotated[Path | None, typer.Option(help="For the set foreign: NPZ, MAT, QPS and MPS files.")] = None,
    test_set: Annotated[
        Path | None, typer.Option(help="For the set test_set: Python file with one of qpbenchmark.")
    ] = None,
    work: Annotated[float, typer.Option(min=1.0, help="For programs of others: bit operations for each proof.")] = WORK,
    as_json: AsJson = False,
) -> None:
    """List the problem sets, or the problems of one.

    Every proof can be checked again, and the problems be written to files.
    """
    of_sets = ("recording", "time", "input", "output", "folder", "test_set", "work", *READING_OPTIONS)
    if problem_set is None and source is None:
        refuse(
            context,
            ("verify", "export", "limit", "seed", *of_sets),
            "needs problems; name a --set, or a folder with --from",
        )
        sets = [(name, _count(cls), cls.description) for name, cls in sorted(all_sets().items())]
        if as_json:
            print_json(records(("set", "problems", "what it is for"), sets))
        else:
            print_table(("set", "problems", "what it is for"), sets, left=3)
        return
    said = as_text(
        recording=recording,
        folder=folder,
        test_set=test_set,
        time=time,
        input=input,
        output=output,
        work=work,
        **reading,
    )
    if source is not None:
        refuse(context, ("seed", *of_sets), "is for making problems, and those in the folder --from are made")
    elif problem_set is not None:
        check_options([problem_set], [option for option in said if option != "work" or is_given(context, "work")])
    chosen, left_out, total = _chosen(problem_set, source, seed, said)
    if export is not None:
        export.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, ...]] = []
    failures: list[str] = []
    exported: dict[str, list[bool]] = defaultdict(list)
    with progress_bar() as progress:
        for done, problem in enumerate(islice(chosen, limit)):
            progress(f"{problem.set_name}/{problem.name}", done, min(total, limit or total))
            proofs = _failures(problem) if verify else {}
            failures += [f"{problem.set_name}/{problem.name} ({scaling}): {why}" for scaling, why in proofs.items()]
            rows.append((*_described(problem), ("; ".join(proofs.values()) or "holds") if verify else ""))
            if export is not None:
                problem.save(export / f"{problem.set_name}--{problem.name}.npz")
                exported[problem.set_name].append(not isinstance(next(iter(problem.forms.values())).qp.P, np.ndarray))
    heads = (
        "problem",
        "optimum",
        "variables",
        "rows",
        "condition",
        "gaps are relative to",
        *(("proofs",) if verify else ()),
    )
    shown = [row[: len(heads)] for row in rows]
    test_sets = (
        [] if export is None else [write_test_set(export, name, any(sparse)) for name, sparse in exported.items()]
    )
    if as_json:
        print_json(
            {
                "problems": records(heads, shown),
                "left_out": dict(left_out),
                "test_sets": test_sets,
                "failures": failures,
            }
        )
    else:
        print_table(heads, shown, left=2)
        for name, why in left_out.items():
            console.print(f"Not certified and therefore not raced: {name}: {why}")
        for path in test_sets:
            console.print(f"Test set of qpbenchmark: {path}")
    if not rows:
        raise ProblemSetError(f"there is no certified problem in {source or problem_set}")
    if verify:
        verdict = _verdict(len(rows), len(left_out), failures)
        if not as_json:
            console.print(verdict)


def _count(cls: type[ProblemSet]) -> str:
    return (
        "needs " + ", ".join(f"--{option.replace('_', '-')}" for option in cls.needs) if cls.needs else str(len(cls()))
    )


def _chosen(
    problem_set: str | None,
    source: Path | None,
    seed: int,
    options: Mapping[str, str],
) -> tuple[Iterator[RaceProblem], Mapping[str, str], int]:
    """The problems, those that are left out and why (known at the end), and how many there are at most."""
    if source is None:
        assert problem_set is not None
        made = make(problem_set, seed, options)
        return made.problems(), made.left_out, len(made)
    if not source.is_dir():
        raise ProblemSetError(f"{source}: is not a folder")
    files = sorted(source.glob("*.npz"))
    loaded = (RaceProblem.load(path) for path in files)
    return (problem for problem in loaded if problem_set in (None, problem.set_name)), {}, len(files)


def _failures(problem: RaceProblem) -> dict[str, str]:
    """What is wrong with the proofs of a problem, by scaling."""
    found = {}
    for scaling, form in problem.forms.items():
        try:
            verify(form.qp, form.certificate)
        except (NotCertified, ValueError) as error:
            found[str(scaling)] = str(error)
    return found


def _described(problem: RaceProblem) -> tuple[str, ...]:
    form = next(iter(problem.forms.values()))
    rows = sum(right.size for right in (form.qp.h, form.qp.b) if right is not None)
    condition = f"{form.condition:.1e}" if form.condition < float("inf") else "singular"
    return problem.name, _optimum(form.certificate), str(problem.d), str(rows), condition, f"{form.yardstick:.3g}"


def _optimum(certificate: Certificate) -> str:
    if certificate.convexity_shift:
        return f"of P + {certificate.convexity_shift:.0e} I, since rounding left P indefinite"
    return "unique" if certificate.unique else "not unique"


def _verdict(count: int, left_out: int, failures: list[str]) -> str:
    """The count of problems whose proofs hold; ProblemSetError where one does not."""
    if failures:
        more = f" and {len(failures) - 1} more" if len(failures) > 1 else ""
        raise ProblemSetError(f"not every proof holds: {failures[0]}{more}")
    share = 100.0 * count / (count + left_out)
    return f"{count} of {count + left_out} problems are certified in every scaling ({share:.0f} %): every proof holds."
