"""Verbs for finished runs: ``verify`` judges the stored answers of one again, ``compare`` tells what changed between
several, ``deploy`` chooses the solver for a controller."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from bench import problems, verification
from bench.cli import FAILED, UNDECIDED
from bench.cli.options import AsJson, NoDynamics, Seed, check_apart, check_option, check_writable, refuse
from bench.comparison import report as comparison_report
from bench.comparison import versions
from bench.comparison.compare import FASTER, SAME, SLOWER, SMALLEST, compare_runs
from bench.deploy import actuator_model, candidates, decision
from bench.races.runs import open_run
from bench.report import words
from bench.report.console import lines_of, print_report, print_result, progress_bar
from bench.store import RunError
from bench.timing import machine
from piezo_model import HysteresisCreepModel
from solvers import Lane

MOST_REFUSED = 5
"""Most solvers for which the reason is printed why they do not qualify."""


def verify_verb(run: Annotated[Path, typer.Argument(help="Folder of the run.")], as_json: AsJson = False) -> None:
    """Judge every stored answer of a run again, from the data of its problems in exact arithmetic.

    It shows that accuracies follow from the stored answers; not who gave them, nor that times and statuses are true.
    """
    with progress_bar() as progress:
        verified = verification.verify_run(open_run(run), progress)
    if wrong := verified["wrong"]:
        raise RunError(
            f"{run} does not agree with its answers: {wrong[0]}" + f", and {len(wrong) - 1} more" * (len(wrong) > 1)
        )
    print_result(
        verified,
        as_json,
        "{rows} rows: {first} first and {timed} timed answers were judged again against {proofs} replayed proofs, and "
        "all give the stored gaps, violations and errors of the model.".format_map(verified),
    )


def compare_verb(
    context: typer.Context,
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN", help="Folders of two runs or more; each is compared with the first."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder for the comparison; compare-A-B beside the last run by default."),
    ] = None,
    fail_on: Annotated[
        Literal["nothing", "regression", "difference"],
        typer.Option(
            help=f"Exit with status {FAILED} on such a change, and with {UNDECIDED} if none is found but the "
            "runs are too noisy to tell."
        ),
    ] = "nothing",
    smallest: Annotated[
        float, typer.Option(metavar="RATIO", help="Smallest ratio of times, above 1, that matters.")
    ] = SMALLEST,
    versions: Annotated[
        bool,
        typer.Option("--versions", help="Compare two Python files with a version of a solver each, timed interleaved."),
    ] = False,
    problem_set: Annotated[
        str, typer.Option("--set", metavar="SET", help="With --versions: the problem set.")
    ] = "measured",
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Show runs side by side, and which solvers became faster, slower, more or less accurate; or two versions.

    Rows meet by the data of the problem, its scaling and start, solver, lane and settings, whatever names, files and
    versions are; runs without a row in common are refused. Times differ only if the change exceeds the noise between
    the runs, and where a change that matters could have gone unseen, the comparison says so.
    """
    check_option(1.0 < smallest < float("inf"), "--smallest", f"must be a finite ratio above 1, not {smallest:g}")
    if versions:
        refuse(context, ("out",), "is for runs; a comparison of versions prints its result")
        raise typer.Exit(_compare_versions(runs, problem_set, seed, smallest, fail_on, as_json))
    refuse(context, ("problem_set", "seed"), "needs --versions")
    check_option(len(runs) >= 2, "RUN", "a comparison needs two runs or more")
    if out is not None:
        check_apart(out, "--out", runs)
    opened = [open_run(path) for path in runs]
    with progress_bar("comparing"):
        compared = compare_runs(opened, smallest)
        result, name = (
            comparison_report.report(compared),
            "-".join(["compare", *(run.path.resolve().name for run in opened)]),
        )
        page = comparison_report.write(compared, result, runs[-1].resolve().parent / name if out is None else out)
    print_report(
        result,
        comparison_report.to_dict(compared),
        as_json,
        lines_of(dict.fromkeys(result.notes)),
        ["", words.OURS_NOTE, f"Comparison: {page}"],
    )
    bad = sum(pair.differences if fail_on == "difference" else pair.regressions for pair in compared.pairs)
    if fail_on != "nothing" and (bad or any(pair.cannot_tell for pair in compared.pairs)):
        raise typer.Exit(FAILED if bad else UNDECIDED)


def _compare_versions(
    files: list[Path], problem_set: str, seed: int, smallest: float, fail_on: str, as_json: bool
) -> int:
    """Print the comparison of two versions; returns the exit status."""
    check_option(len(files) == 2, "RUN", "two versions are compared, A.py and B.py")
    with progress_bar() as progress:
        result = versions.compare_versions(
            files, list(problems.make(problem_set, seed).problems()), smallest, seed, progress
        )
    (a, b), finding = files, result["finding"]
    verdicts = {
        FASTER: f"{b} is faster than {a}",
        SLOWER: f"{b} is slower than {a}",
        SAME: f"{b} takes as long as {a}, within a ratio of {smallest:g}",
    }
    lines = [
        f"{verdicts.get(finding, 'The times vary too much to tell')}: the ratio of their times is "
        f"{result['ratio']:.3f}, 95 % interval {result['low']:.3f} to {result['high']:.3f} ({result['us'][1]:.3g} and "
        f"{result['us'][0]:.3g} µs).",
        f"Largest error of a first answer: {b} {result['gap'][1]:.1e}, {a} {result['gap'][0]:.1e}.",
        f"{b} is less accurate than {a}." if result["less_accurate"] else "",
    ]
    print_result(result, as_json, *lines)
    if finding == SLOWER or result["less_accurate"] or (fail_on == "difference" and finding == FASTER):
        return FAILED if fail_on != "nothing" else 0
    return UNDECIDED if fail_on != "nothing" and finding not in verdicts else 0


def deploy_verb(
    context: typer.Context,
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json", help="File for the compensator; compensator.json in the run by default."),
    ] = None,
    accuracy: Annotated[
        float,
        typer.Option(metavar="GAP", min=0.0, help="Largest relative cost gap and constraint violation on any problem."),
    ] = 1e-9,
    deadline: Annotated[
        float | None,
        typer.Option(metavar="US", min=0.0, help="Deadline in µs; the model's sampling period by default."),
    ] = None,
    misses: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            help="Missed deadlines allowed beyond those that a solver that does nothing misses in the run.",
        ),
    ] = 0,
    lane: Annotated[
        list[Lane] | None,
        typer.Option(
            metavar="|".join(Lane), help="Lane that the controller can use, repeatable; kernel and direct by default."
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help="Model of your actuator from identify; not needed if the race used your recording.",
        ),
    ] = None,
    problem: Annotated[
        str | None,
        typer.Option(
            metavar="SET/NAME",
            help="Use the model of this problem of the run, set/name; by default that of your recording, if the race "
            "used one.",
        ),
    ] = None,
    simulated: Annotated[bool, typer.Option("--simulated", help="Allow the model of a simulated actuator.")] = False,
    no_dynamics: NoDynamics = False,
    as_json: AsJson = False,
) -> None:
    """Choose the solver for a controller, and say why.

    The solver is accurate enough on every problem, misses no deadline beyond those that the machine itself misses, and
    has the smallest p99.9 (99.9 % of its answers take at most this time). The model comes from --model, or from
    identifying the recording of the race. In Python, Deployment.load(FILE).learner() of bench.deploy.deployment starts
    from the written file.
    """
    own_model = None
    if model is None:
        refuse(context, ("no_dynamics",), "is for a model that --model gives; those of a run are static")
    else:
        refuse(context, ("problem", "simulated"), "selects a model of the run, and --model gives another")
        own_model = HysteresisCreepModel.load(model)
        own_model = own_model.static if no_dynamics else own_model
    opened = open_run(run)
    target = run / "compensator.json" if out is None else out
    check_writable(target, others=[model, *([] if out is None else [run])])
    with progress_bar("judging the model and weighing the solvers"):
        actuator = actuator_model.model_for(opened, own_model, problem, simulated, source=str(model))
        period_us = 1e6 * actuator.model.structure.sample_time
        rule = candidates.Rule(
            accuracy,
            period_us if deadline is None else deadline,
            tuple(lane or (Lane.KERNEL, Lane.DIRECT)),
            misses,
        )
        decided = decision.decide(opened, rule)
    made = decided.deployment(actuator)
    made.save(target)
    elsewhere = machine.elsewhere(f"The run {opened.path.name}", opened.machine_names)
    lines = [
        *decided.sentences(),
        *elsewhere,
        *(f"Not qualified: {candidate.name} {why}." for candidate, why in decided.refused[:MOST_REFUSED]),
        actuator.model.warning,
        f"Model: from {actuator.source}.{actuator.sentence and f' {actuator.sentence}'}",
        words.OURS_NOTE,
        f"Compensator: {target}",
    ]
    print_result(
        {
            "file": target,
            "solver": made.solver,
            "lane": made.lane,
            "tier": made.tier,
            "settings": dict(made.settings),
            "mode": made.mode,
            "model_from": actuator.source,
            "forced": actuator.model.warning,
            "error_percent": actuator.error_percent,
            "last_fifth": actuator.last_fifth,
            "rule": rule.sentence,
            "why": decided.sentences(),
            "elsewhere": elsewhere,
            "figures": decided.chosen.metrics(),
            "runners_up": [candidate.metrics() for candidate in decided.runners_up],
            "refused": [{**candidate.metrics(), "why": why} for candidate, why in decided.refused],
        },
        as_json,
        *lines,
    )
