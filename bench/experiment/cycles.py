"""Error against cycle number, on a steady stage and on a drifting one.

The paper learns while running because a compensator that is designed once, before start-up, ignores temperature and
ageing. On the drifting stage, such a compensator learns for two cycles and then keeps its model.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from bench.experiment.figures import HINDSIGHT, LEARNED, ONCE, STRAIGHT, lines
from bench.report.report import Axis, Figure
from bench.stage.setup import AXES
from bench.stage.trial import Trial, learned
from solvers.arrays import Vector

DRIFT_PER_CYCLE = 5e-3
"""Change of the actuators' gain in one cycle."""
FIXED_AFTER = 2
"""Cycles after which the fixed compensator stops learning."""
STEADY, DRIFTING = "steady", "drifting"


def per_cycle(trial: Trial) -> Vector:
    """RMS error of every cycle in percent of range, both axes taken together, shape (cycles,)."""
    return np.array([np.sqrt(np.mean(trial.rms_percent(c) ** 2)) for c in range(trial.setup.cycles)])


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
        (DRIFTING, LEARNED): learned(drifting),
        (DRIFTING, ONCE): learned(drifting, FIXED_AFTER),
    }
    return pd.DataFrame(
        [
            {"stage": stage, "name": name, "cycle": cycle, "percent": percent}
            for (stage, name), trial in trials.items()
            for cycle, percent in enumerate(per_cycle(trial), 1)
        ]
    )


def figure(table: pd.DataFrame) -> Figure:
    """The errors on the steady stage, and below on the drifting one."""
    last = int(table.cycle.max())
    cycle = Axis(
        "cycle", "cycle", values=range(1, last + 1), label="format(datum.value, 'd')", domain=(0.8, last + 0.2)
    )
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
            lines(cycle, error, names, {"stage": [stage]}, points=True)
            for stage, names in ((STEADY, (STRAIGHT, HINDSIGHT, LEARNED)), (DRIFTING, (ONCE, LEARNED)))
        ],
    )


def sentences(table: pd.DataFrame) -> tuple[str, str]:
    """The first cycle in which learning has settled, and its benefit on the drifting stage."""
    found = {key: part.percent.to_numpy() for key, part in table.groupby(["stage", "name"])}
    steady, drifting, once = found[STEADY, LEARNED], found[DRIFTING, LEARNED], found[DRIFTING, ONCE]
    settled = int(np.argmax(steady <= 2.0 * steady.min())) + 1
    return (
        f"Both axes together: from {steady[0]:.2f} % in cycle 1, in which nothing is known, to {steady[-1]:.3f} % "
        f"in cycle {steady.size}; cycle {settled} is the first within twice the best.",
        f"Where the gain drifts by {100 * DRIFT_PER_CYCLE:g} % a cycle, a compensator that stopped learning after "
        f"{FIXED_AFTER} cycles is at "
        f"{once[-1]:.2f} % in cycle {once.size} and the one that learns on at {drifting[-1]:.2f} %.",
    )
