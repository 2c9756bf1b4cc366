"""The paper's experiment on a simulated two-axis stage, with all figures and the report.

Of the last cycle: the paper's Fig. 4, a staircase of each axis without and with compensation, and the hysteresis loops
before and after. Of all: error against cycle number, on a steady stage and on a drifting one. The paper learns while
running because a compensator that is designed once, before start-up, ignores temperature and ageing. On the drifting
stage, such a compensator learns for two cycles and then keeps its model.

`bench.stage` simulates the stage and its runs. Figures 1 to 3, and others, are scripts in ``examples/paper/`` of
the repository.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from bench.messages.task import Progress, silent
from bench.report.report import INK, PALETTE, Axis, Figure, Mark, Plot, Report, Table
from bench.report.writing import write_report
from bench.stage import trial
from bench.stage.setup import AMPLITUDE_UM, AXES, LEVELS, RANGE_UM, StageSetup, percent
from bench.stage.trial import Trial
from solvers.arrays import Vector

REFERENCE, STRAIGHT, HINDSIGHT, LEARNED, ONCE = (
    "reference",
    "straight line",
    "best straight line with hindsight",
    "self-learning",
    "learned for 2 cycles, then fixed",
)
BLUE, RED, GREEN, PURPLE = PALETTE[:4]
COLOURS = {REFERENCE: INK, STRAIGHT: RED, HINDSIGHT: GREEN, LEARNED: BLUE, ONCE: PURPLE}
DRIFT_PER_CYCLE = 5e-3
"""Change of the actuators' gain in one cycle."""
FIXED_AFTER = 2
"""Cycles after which the fixed compensator stops learning."""
STEADY, DRIFTING = "steady", "drifting"
THINNING = 16
"""Ratio of samples to drawn points, which gives 500 Hz."""
BINS = 64
"""Intervals of the reference in which the opening of a loop is measured."""


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
    found = report(setup, runs, errors(runs))
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
        figures=[*(staircase(i, runs) for i in indices), loops(runs), cycles(by_cycle)],
        notes=[*sentences(runs, by_cycle)],
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


def sentences(runs: Mapping[str, Trial], by_cycle: pd.DataFrame) -> Iterator[str]:
    """Errors of each axis in the last cycle; opening of its loops; the first cycle in which learning has settled, and
    its benefit on the drifting stage."""
    names, setup = (STRAIGHT, HINDSIGHT, LEARNED), runs[LEARNED].setup
    for i, axis in enumerate(AXES):
        before, best, after = (float(runs[name].rms_percent()[i]) for name in names)
        worst = [float(np.abs(percent(runs[name].cycle_error_um(-1)))[:, i].max()) for name in names]
        yield (
            f"Axis {axis}, last cycle: RMS error {before:.2f} % of range ({before / 100 * RANGE_UM:.2f} µm) along a "
            f"straight line, {best:.2f} % along the best straight line with hindsight, {after:.3f} % "
            f"({after / 100 * RANGE_UM * 1e3:.0f} nm) with self-learning compensation, {before / after:.0f} times "
            f"less; largest error {worst[0]:.1f} %, {worst[1]:.1f} % and {worst[2]:.2f} %."
        )
    part = slice(arrived(setup), None)
    for i, axis in enumerate(AXES):
        wide, narrow = (
            opening_percent(setup.loop_ref[part, i], runs[name].loop[part, i]) for name in (STRAIGHT, LEARNED)
        )
        yield (
            f"Axis {axis}: the loops open by {wide:.1f} % of range along a straight line and by {narrow:.2f} % with "
            "compensation, on a signal that was never learned from."
        )
    found = {key: part.percent.to_numpy() for key, part in by_cycle.groupby(["stage", "name"])}
    steady, drifting, once = found[STEADY, LEARNED], found[DRIFTING, LEARNED], found[DRIFTING, ONCE]
    settled = int(np.argmax(steady <= 2.0 * steady.min())) + 1
    yield (
        f"Both axes together: from {steady[0]:.2f} % in cycle 1, in which nothing is known, to {steady[-1]:.3f} % "
        f"in cycle {steady.size}; cycle {settled} is the first within twice the best."
    )
    yield (
        f"Where the gain drifts by {100 * DRIFT_PER_CYCLE:g} % a cycle, a compensator that stopped learning after "
        f"{FIXED_AFTER} cycles is at "
        f"{once[-1]:.2f} % in cycle {once.size} and the one that learns on at {drifting[-1]:.2f} %."
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


def lines(
    x: Axis,
    y: Axis,
    names: Sequence[str],
    along: str = "",
    points: bool = False,
    height: int = 240,
    **where: Sequence[object],
) -> Plot:
    """One line for each of these names, from the rows of a table that ``where`` selects."""
    marks = Mark("line", "name", along=along), *([Mark("point", "name", size=50.0)] if points else [])
    return Plot(
        x, y, marks, where={"name": names, **where}, colours={name: COLOURS[name] for name in names}, height=height
    )


def staircase(i: int, runs: Mapping[str, Trial]) -> Figure:
    """One period of the staircase in the last cycle of one axis."""
    setup = runs[LEARNED].setup
    end = len(setup.y_ref)
    window = np.arange(max(0, end - setup.period), end, THINNING)
    t, reference = (window - window[0]) * setup.sample_time, setup.y_ref[window, i]
    positions = {REFERENCE: reference, **{name: run.y[window, i] for name, run in runs.items()}}
    table = pd.concat(
        [
            pd.DataFrame({"time_s": t, "name": name, "position_um": y, "error_um": y - reference})
            for name, y in positions.items()
        ],
        ignore_index=True,
    )
    time, error = Axis("time_s", "time, s"), Axis("error_um", "error, µm")
    plots = [
        lines(time, Axis("position_um", f"position {AXES[i]}, µm"), (STRAIGHT, LEARNED, REFERENCE)),
        lines(time, error, (STRAIGHT, HINDSIGHT), height=150),
        lines(time, error, (LEARNED,), height=150),
    ]
    return Figure(
        f"fig4_staircase_{AXES[i]}",
        f"Fig. 4: staircase, axis {AXES[i]}",
        "One period of the staircase in the last cycle. All runs stand behind the same decoupling matrix.",
        table,
        plots,
    )


def loops(runs: Mapping[str, Trial]) -> Figure:
    """The loops of both axes, and the remaining error on a finer scale."""
    setup = runs[LEARNED].setup
    at = np.arange(arrived(setup), len(setup.loop_ref), THINNING)
    table = pd.concat(
        [
            pd.DataFrame(
                {
                    "axis": axis,
                    "name": name,
                    "sample": at,
                    "reference_um": (reference := setup.loop_ref[at, i]),
                    "position_um": (y := runs[name].loop[at, i]),
                    "error_um": y - reference,
                }
            )
            for i, axis in enumerate(AXES)
            for name in (STRAIGHT, LEARNED)
        ],
        ignore_index=True,
    )
    plots = []
    for axis in AXES:
        x = Axis("reference_um", f"reference {axis}, µm")
        plots += [
            lines(x, Axis("position_um", "measured position, µm"), (STRAIGHT, LEARNED), "sample", axis=[axis]),
            lines(x, Axis("error_um", "error, µm"), (LEARNED,), "sample", height=150, axis=[axis]),
        ]
    return Figure(
        "loops",
        "Hysteresis loops before and after",
        "Measured position over reference for triangles of "
        "falling amplitude, on signals that were never learned from; below each, what compensation leaves.",
        table,
        plots,
    )


def arrived(setup: StageSetup) -> int:
    """First sample of the loops that counts; before it the stage moves there from the staircase."""
    return round(setup.step_s / setup.sample_time)


def opening_percent(reference: Vector, y: Vector) -> float:
    """Widest opening of the loops in percent of the range: the largest spread of the error within one of BINS intervals
    of the reference."""
    share = (reference + AMPLITUDE_UM) / RANGE_UM
    bins = np.clip((share * BINS).astype(int), 0, BINS - 1)
    error = y - reference
    return 100.0 / RANGE_UM * max(float(np.ptp(error[bins == i])) for i in range(BINS) if np.any(bins == i))


def errors(runs: Mapping[str, Trial]) -> pd.DataFrame:
    """Errors by stage, name and cycle: of the runs on the steady stage, and of two on the drifting one."""
    setup = runs[LEARNED].setup
    drifting = replace(
        setup,
        gain_drift_per_s=DRIFT_PER_CYCLE / (setup.cycle * setup.sample_time),
        cycles=max(setup.cycles, FIXED_AFTER + 2),
    )
    trials = {
        **{(STEADY, name): run for name, run in runs.items()},
        (DRIFTING, LEARNED): trial.learned(drifting),
        (DRIFTING, ONCE): trial.learned(drifting, FIXED_AFTER),
    }
    return pd.DataFrame(
        [
            {"stage": stage, "name": name, "cycle": cycle, "percent": percent}
            for (stage, name), run in trials.items()
            for cycle, percent in enumerate(run.rms_by_cycle, 1)
        ]
    )


def cycles(table: pd.DataFrame) -> Figure:
    """The errors on the steady stage, and below on the drifting one."""
    last = int(table.cycle.max())
    cycle = Axis("cycle", "cycle", values=range(1, last + 1), format="d", domain=(0.8, last + 0.2))
    error = Axis("percent", "RMS error, % of range", log=True)
    return Figure(
        "cycles",
        "Error against cycle number",
        f"RMS error of axes {' and '.join(AXES)} together in each "
        "cycle; weights are handed over "
        "where a cycle ends. Above, a stage that stays as it is; below, one whose gain drifts by "
        f"{100 * DRIFT_PER_CYCLE:g} % a cycle.",
        table,
        [
            lines(cycle, error, names, points=True, stage=[stage])
            for stage, names in ((STEADY, (STRAIGHT, HINDSIGHT, LEARNED)), (DRIFTING, (ONCE, LEARNED)))
        ],
    )
