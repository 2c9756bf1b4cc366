"""Verbs that make something of finished runs: ``compare`` them, ``deploy`` what one has found."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from bench.cli.options import refuse
from bench.comparison import report as comparison_report
from bench.comparison.compare import SMALLEST, compare_runs
from bench.deploy.actuator_model import model_for
from bench.deploy.decision import decide
from bench.deploy.deployment import deployment
from bench.deploy.rule import Rule
from bench.races.kind import open_run
from bench.report.console import AsJson, check_writable, console, lines_of, print_json, print_report, progress_bar
from bench.report.words import OURS_NOTE
from piezo_model import HysteresisCreepModel
from solvers import Lane

FAILED, CANNOT_TELL = 3, 4
"""Exit status of a comparison that found what it was told to fail on, and of one that could not have found it."""
NEAREST = 5
"""Solvers of which it says why they do not qualify."""


def compare_verb(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN_A RUN_B [RUN_C ...]", help="Folders of runs; all are compared with the first."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the comparison; compare-A-B beside the last run by default.")
    ] = None,
    fail_on: Annotated[
        Literal["nothing", "regression", "difference"],
        typer.Option(
            help=f"What ends with exit status {FAILED}; with {CANNOT_TELL} where nothing is found and the runs cannot "
            "tell."
        ),
    ] = "nothing",
    smallest: Annotated[
        float, typer.Option(help="Smallest change of times that matters, as a ratio above 1.")
    ] = SMALLEST,
    as_json: AsJson = False,
) -> None:
    """Compare runs: what is faster, slower, more or less accurate.

    Times count as different, solver lane by solver lane, only beyond the noise that the runs themselves show; where a
    change that matters could not have been seen, it says so.
    """
    if not smallest > 1.0:
        raise typer.BadParameter(f"a change of times is a ratio above 1, and not {smallest:g}", param_hint="--smallest")
    if len(runs) < 2:
        raise typer.BadParameter("a comparison needs two runs or more", param_hint="RUN_A RUN_B")
    opened = [open_run(path) for path in runs]
    with progress_bar() as progress:
        found = []
        for done, other in enumerate(opened[1:]):
            progress(f"{other.path.name} against {opened[0].path.name}", done, len(opened) - 1)
            found.append(compare_runs(opened[0], other, smallest))
        progress("writing the page", len(found), len(found))
        names = "-".join(run.path.resolve().name for run in opened)
        report = comparison_report.report(found)
        page = comparison_report.write(
            found, report, runs[-1].resolve().parent / f"compare-{names}" if out is None else out
        )
    if as_json:
        print_json(comparison_report.to_dict(found))
    else:
        print_report(report, lines_of(report.notes))
        console.print(f"\n{OURS_NOTE}\nComparison: {page}")
    bad = sum(each.differences if fail_on == "difference" else each.regressions for each in found)
    if fail_on != "nothing" and (bad or any(each.cannot_tell for each in found)):
        raise typer.Exit(FAILED if bad else CANNOT_TELL)


def deploy_verb(
    context: typer.Context,
    run: Annotated[Path, typer.Argument(help="Folder of a one-shot race or of a stream.")],
    out: Annotated[
        Path | None, typer.Option(help="Where the decision is written; compensator.json in the run by default.")
    ] = None,
    accuracy: Annotated[
        float, typer.Option(min=0.0, help="Largest relative cost gap and violation, on every problem.")
    ] = 1e-9,
    deadline: Annotated[float, typer.Option(min=0.0, help="Deadline in µs.")] = 125.0,
    misses: Annotated[
        int,
        typer.Option(
            min=0, help="Deadlines that may be missed beyond those that a solver that does nothing misses here, too."
        ),
    ] = 0,
    lane: Annotated[
        list[Lane] | None,
        typer.Option(help="Lane that the controller can have; may be given again. Kernel and direct by default."),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(help="Model of your actuator, written by identify; not needed if the race was on your recording."),
    ] = None,
    problem: Annotated[
        str | None,
        typer.Option(
            help="Problem of the run whose model is taken, as set/name; by default "
            "the model of your recording, if the race was on one."
        ),
    ] = None,
    simulated: Annotated[bool, typer.Option("--simulated", help="Take the model of a simulated actuator.")] = False,
    as_json: AsJson = False,
) -> None:
    """Pick the solver for a controller, and say why.

    It is exact enough on every problem, misses no deadline beyond those that the machine itself misses, and has the
    lowest p99.9 (the time that 99.9 % of its answers need at most). The model comes from --model, or is what identify
    makes of the recording that was raced on. SelfLearningCompensator.load starts from the file that is written.
    """
    if model is not None:
        refuse(context, ("problem", "simulated"), "says which model of the run is taken, and --model gives another")
    opened = open_run(run)
    target = run / "compensator.json" if out is None else out
    check_writable(target)
    rule = Rule(accuracy, deadline, tuple(lane or (Lane.KERNEL, Lane.DIRECT)), misses)
    with progress_bar() as progress:
        progress("weighing the solvers", 0, 2)
        decision = decide(opened, rule)
        progress("judging the model", 1, 2)
        found = model_for(
            opened, None if model is None else HysteresisCreepModel.load(model), problem, simulated, source=str(model)
        )
    made = deployment(decision, found)
    made.save(target)
    if as_json:
        print_json(
            {
                "file": target,
                "solver": made.solver,
                "lane": made.lane,
                "tier": made.tier,
                "settings": dict(made.settings),
                "mode": made.mode,
                "model_from": found.source,
                "forced": found.model.warning,
                "unseen_error_percent": found.error_percent,
                "rule": rule.sentence,
                "why": decision.sentences(),
                "figures": decision.chosen.figures(),
                "runners_up": [each.figures() for each in decision.runners_up],
                "refused": [{**each.figures(), "why": why} for each, why in decision.refused],
            }
        )
        return
    for sentence in decision.sentences():
        console.print(sentence)
    for each, why in decision.refused[:NEAREST]:
        console.print(f"Not qualified: {each.name} {why}.")
    if found.model.warning:
        console.print(found.model.warning)
    console.print(
        f"Model: from {found.source}.{found.sentence and f' {found.sentence}'}\n{OURS_NOTE}\nCompensator: {target}"
    )
