"""The paper's experiment on a simulated two-axis stage: its Fig. 4, a staircase without and with compensation.

Of the last cycle: a staircase of each axis, and the hysteresis loops before and after. Of all: error against cycle
number, on a steady stage and on a drifting one. The paper learns while running because a compensator that is designed
once, before start-up, ignores temperature and ageing. On the drifting stage, such a compensator learns for two cycles
and then keeps its model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from outputs import arguments, show
from two_axis_stage import (
    AMPLITUDE_UM,
    AXES,
    RANGE_UM,
    Trial,
    best_straight,
    learned,
    lines,
    setup_of,
    straight,
)

from bench.report.report import INK, PALETTE, Axis, Figure, Mark, Plot

REFERENCE, STRAIGHT, HINDSIGHT, LEARNED, ONCE = (
    "reference",
    "straight line",
    "best straight line with hindsight",
    "self-learning",
    "learned for 2 cycles, then fixed",
)
COLOURS = dict(zip((REFERENCE, LEARNED, STRAIGHT, HINDSIGHT, ONCE), (INK, *PALETTE), strict=False))
DRIFT_PER_CYCLE = 5e-3
"""Change of the actuators' gain in one cycle."""
FIXED_AFTER = 2
"""Cycles after which the fixed compensator stops learning."""
THINNING = 16
"""Ratio of samples to drawn points, which gives 500 Hz."""
BINS = 64
"""Intervals of the reference in which the opening of a loop is measured."""
Trials = Mapping[str, Trial]
Drawn = tuple[Figure, list[str]]
"""A figure, and sentences about it."""


def plot(x: Axis, y: Axis, names: Sequence[str], along: str = "", height: int = 240, **where: Sequence[object]) -> Plot:
    """One line for each of these names, from the rows of a table that ``where`` selects."""
    marks = Mark("line", "name", along=along), *([] if along else [Mark("point", "name", size=50.0)])
    colours = {name: COLOURS[name] for name in names}
    return Plot(x, y, marks, where={"name": names, **where}, colours=colours, height=height)


def staircase(runs: Trials, i: int) -> Drawn:
    """One period of the staircase in the last cycle of one axis."""
    setup, axis = runs[LEARNED].setup, AXES[i]
    window = np.arange(-setup.period, 0, THINNING)
    t, reference = (window + setup.period) * setup.sample_time, setup.y_ref[window, i]
    positions = {REFERENCE: reference, **{name: run.y[window, i] for name, run in runs.items()}}
    table = pd.concat(
        pd.DataFrame({"time_s": t, "name": name, "position_um": y, "error_um": y - reference})
        for name, y in positions.items()
    )
    time, error = Axis("time_s", "time, s"), Axis("error_um", "error, µm")
    (before, best, after), (far, near, nearest) = (
        [float(errors[name]) for name in (STRAIGHT, HINDSIGHT, LEARNED)]
        for errors in (
            {name: run.rms[-1, i] for name, run in runs.items()},
            {name: np.abs(run.errors[-1, :, i]).max() for name, run in runs.items()},
        )
    )
    return Figure(
        f"fig4_staircase_{axis}",
        f"Fig. 4: staircase, axis {axis}",
        "One period of the staircase in the last cycle. All runs stand behind the same decoupling matrix.",
        table,
        [
            plot(time, Axis("position_um", f"position {axis}, µm"), (STRAIGHT, LEARNED, REFERENCE), "time_s"),
            plot(time, error, (STRAIGHT, HINDSIGHT), "time_s", 150),
            plot(time, error, (LEARNED,), "time_s", 150),
        ],
    ), [
        f"Axis {axis}, last cycle: RMS error {before:.2f} % of range ({before / 100 * RANGE_UM:.2f} µm) along a "
        f"straight line, {best:.2f} % along the best straight line with hindsight, {after:.3f} % "
        f"({after / 100 * RANGE_UM * 1e3:.0f} nm) with self-learning compensation, {before / after:.0f} times less; "
        f"largest error {far:.1f} %, {near:.1f} % and {nearest:.2f} %."
    ]


def loops(runs: Trials) -> Drawn:
    """The loops of both axes, and the remaining error on a finer scale; their opening is the largest spread of the
    error within one of BINS intervals of the reference."""
    setup = runs[LEARNED].setup
    at = np.arange(round(setup.step_s / setup.sample_time), len(setup.loop_ref))  # the stage has moved there
    table = pd.concat(
        pd.DataFrame(
            {
                "axis": axis,
                "name": name,
                "sample": at,
                "reference_um": setup.loop_ref[at, i],
                "position_um": runs[name].loop[at, i],
                "error_um": (runs[name].loop - setup.loop_ref)[at, i],
            }
        )
        for i, axis in enumerate(AXES)
        for name in (STRAIGHT, LEARNED)
    )
    bins = ((table.reference_um + AMPLITUDE_UM) / RANGE_UM * BINS).astype(int).clip(0, BINS - 1)
    spread = table.error_um.groupby([table.axis, table.name, bins]).agg(np.ptp).groupby(level=[0, 1]).max()
    plots = []
    for axis in AXES:
        x, y = Axis("reference_um", f"reference {axis}, µm"), Axis("position_um", "measured position, µm")
        plots += [
            plot(x, y, (STRAIGHT, LEARNED), "sample", axis=[axis]),
            plot(x, Axis("error_um", "error, µm"), (LEARNED,), "sample", 150, axis=[axis]),
        ]
    return Figure(
        "loops",
        "Hysteresis loops before and after",
        "Measured position over reference for triangles of falling amplitude, on signals that were never learned from; "
        "below each, what compensation leaves.",
        table[::THINNING],
        plots,
    ), [
        f"Axis {axis}: the loops open by {100 * spread[axis, STRAIGHT] / RANGE_UM:.1f} % of range along a straight "
        f"line and by {100 * spread[axis, LEARNED] / RANGE_UM:.2f} % with compensation, on a signal that was never "
        "learned from."
        for axis in AXES
    ]


def cycles(runs: Trials) -> Drawn:
    """Errors of both axes together by cycle, on the steady stage, and below of two learners on the drifting one."""
    setup = runs[LEARNED].setup
    drifting = replace(setup, gain_drift_per_s=DRIFT_PER_CYCLE / (setup.cycle * setup.sample_time))
    drifted = {LEARNED: learned(drifting), ONCE: learned(drifting, FIXED_AFTER)}
    table = pd.DataFrame(
        {"stage": stage, "name": name, "cycle": cycle, "percent": percent}
        for stage, trials in (("steady", runs), ("drifting", drifted))
        for name, run in trials.items()
        for cycle, percent in enumerate(np.sqrt(np.mean(run.rms**2, axis=1)), 1)
    )
    percents = table.set_index(["stage", "name"]).percent.groupby(level=[0, 1]).agg(list)
    steady, count = percents["steady", LEARNED], setup.cycles
    settled = next(cycle for cycle, percent in enumerate(steady, 1) if percent <= 2.0 * min(steady))
    cycle = Axis("cycle", "cycle", values=range(1, count + 1), format="d", domain=(0.8, count + 0.2))
    error = Axis("percent", "RMS error, % of range", log=True)
    return Figure(
        "cycles",
        "Error against cycle number",
        f"RMS error of axes {' and '.join(AXES)} together in each cycle; weights are handed over where a cycle ends. "
        f"Above, a stage that stays as it is; below, one whose gain drifts by {100 * DRIFT_PER_CYCLE:g} % a cycle.",
        table,
        [plot(cycle, error, (*runs,), stage=["steady"]), plot(cycle, error, (ONCE, LEARNED), stage=["drifting"])],
    ), [
        f"Both axes together: from {steady[0]:.2f} % in cycle 1, in which nothing is known, to {steady[-1]:.3f} % in "
        f"cycle {count}; cycle {settled} is the first within twice the best.",
        f"Where the gain drifts by {100 * DRIFT_PER_CYCLE:g} % a cycle, a compensator that stopped learning after "
        f"{FIXED_AFTER} cycles is at {percents['drifting', ONCE][-1]:.2f} % in cycle {count} and the one that learns "
        f"on at {percents['drifting', LEARNED][-1]:.2f} %.",
    ]


def verdict(runs: Trials) -> str:
    """The experiment in one sentence."""
    before, best, after = (float(np.sqrt(np.mean(runs[name].rms[-1] ** 2))) for name in (STRAIGHT, HINDSIGHT, LEARNED))
    return (
        f"Self-learning compensation brings the stage from {before:.2f} % to {after:.3f} % RMS of range, "
        f"{before / after:.0f} times nearer to the reference than a straight line and {best / after:.0f} times nearer "
        f"than the best straight line that hindsight can give ({best:.2f} %)."
    )


def main() -> None:
    """Drive the stage along straight lines and with learning, and draw all figures."""
    given = arguments(quick=False, seed=0, solver="projected_difference")
    setup = setup_of(given, solver=given.solver)
    runs = {LEARNED: learned(setup), STRAIGHT: straight(setup, *lines(setup)), HINDSIGHT: best_straight(setup)}
    drawn = [*(staircase(runs, i) for i in range(len(AXES))), loops(runs), cycles(runs)]
    show(
        [figure for figure, _ in drawn],
        [verdict(runs), *(sentence for _, sentences in drawn for sentence in sentences)],
        given.out,
    )


if __name__ == "__main__":
    main()
