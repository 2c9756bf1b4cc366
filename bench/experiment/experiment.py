"""The experiment: its runs, and the report with all figures."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from bench.experiment import figures
from bench.experiment.figures import HINDSIGHT, LEARNED, STRAIGHT
from bench.messages.progress import Progress, silent
from bench.report.report import Report, Table
from bench.report.writing import write_report
from bench.stage import trial
from bench.stage.setup import AXES, LEVELS, RANGE_UM, StageSetup
from bench.stage.trial import Trial


def run(folder: Path, setup: StageSetup, progress: Progress = silent) -> tuple[Report, Path]:
    """Run the experiment and write its report and figures into a folder, which is created if necessary; OSError if that
    fails."""
    folder.mkdir(parents=True, exist_ok=True)
    runs: dict[str, Trial] = {}
    for done, (name, made) in enumerate(
        {STRAIGHT: trial.straight, HINDSIGHT: trial.best_straight, LEARNED: trial.learned}.items()
    ):
        progress(name, done, 5)
        runs[name] = made(setup)
    progress("a drifting stage", 3, 5)
    found = report(setup, runs, figures.errors(runs))
    progress("figures", 4, 5)
    return found, write_report(found, folder, "experiment", pictures=len(found.figures))


def report(setup: StageSetup, runs: Mapping[str, Trial], by_cycle: pd.DataFrame) -> Report:
    """Report of the runs."""
    indices = range(len(AXES))
    rows = [
        [AXES[i], *(f"{runs[name].rms_percent()[i]:.3f}" for name in (STRAIGHT, HINDSIGHT, LEARNED))] for i in indices
    ]
    return Report(
        [verdict(runs)],
        Table("RMS error in the last cycle, % of range", ("axis", STRAIGHT, HINDSIGHT, LEARNED), rows),
        figures=[*(figures.staircase(i, runs) for i in indices), figures.loops(runs), figures.cycles(by_cycle)],
        notes=[
            *(figures.staircase_sentence(i, runs) for i in indices),
            *figures.loop_sentences(runs),
            *figures.cycle_sentences(by_cycle),
        ],
        definitions=[
            "A straight line is the one through the corners of the ranges. Errors are those of the measured "
            "platform in percent of the reference's range."
        ],
        environment=settings(setup),
        title="Self-learning compensation of a two-axis stage",
    )


def verdict(runs: Mapping[str, Trial]) -> str:
    """The experiment in one sentence."""
    before, best, after = (
        float(np.sqrt(np.mean(runs[name].rms_percent() ** 2))) for name in (STRAIGHT, HINDSIGHT, LEARNED)
    )
    first = f"Self-learning compensation brings the stage from {before:.2f} % to {after:.3f} % RMS of range"
    if not after < best:
        return f"{first}: a straight line with hindsight would have done as well ({best:.2f} %)."
    return (
        f"{first}, {before / after:.0f} times nearer to the reference than a straight line and {best / after:.0f} "
        f"times nearer than the best straight line that hindsight can give ({best:.2f} %)."
    )


def settings(setup: StageSetup) -> list[tuple[str, str]]:
    """Stage, reference, model and learning of the experiment."""
    kinds = ", ".join(f"{axis}: {actuators.plant}" for axis, actuators in zip(AXES, setup.actuators, strict=True))
    return [
        (
            "stage",
            f"two axes, {'two actuators in push-pull' if setup.push_pull else 'one actuator'} each ({kinds}), "
            "cross-coupled, with structural "
            f"dynamics, noise of {1e3 * setup.noise_um:g} nm and steps of {1e3 * setup.quantum_um:g} nm in the sensors",
        ),
        (
            "reference",
            f"staircase of {LEVELS} levels over {RANGE_UM:g} µm, each held {setup.hold_s:g} s, a step "
            f"taking {1e3 * setup.step_s:g} ms; axis y a quarter of a period ahead",
        ),
        ("model", f"n = {setup.n}, m = {setup.m}"),
        (
            "learning",
            f"{setup.cycles} cycles of {setup.reset_s:g} s reset, {setup.build_s:g} s building and "
            f"{setup.learn_s:g} s learning; solver "
            f"{setup.solver}; a sample every {1e6 * setup.sample_time:g} µs; seed {setup.seed}",
        ),
    ]
