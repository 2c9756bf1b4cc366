"""Does the stage notice how exact the solver is? Each learns in the same loop (`two_axis_stage`), with the same noise.

The paper's method takes one step per sample, in learning phases of several lengths; any other solver has its defaults
or its tightest setting, and its answer is due after one sample. The cost gap is exact: that of the weights in use at
the end, against the certified optimum of the data that they were learned from, for the worse axis. The tracking error
is that of both axes over the last period of the staircase.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from outputs import arguments, show
from two_axis_stage import RANGE_UM, Trial, learned, setup_of

from bench.report.report import LEAST_GAP, PALETTE, Axis, Figure, Mark, Plot
from piezo_model import SelfLearningCompensator
from piezo_model.identification.error_model import prove
from piezo_model.learning.events import Phase
from solvers import find
from solvers.protocol import setting_text

PAPERS = "projected_difference"
STEPS = (1, 10, 100, 1000, 15200)
"""Lengths of the learning phase of the paper's method, in samples; the last is the paper's."""
SOLVERS = "box_active_set,accelerated_projection,daqp,quadprog,piqp,clarabel,proxsuite,qpalm,osqp,scs"
NOTICED = 1.1
"""Smallest ratio to the least error that counts as a difference."""


def learners(names: Sequence[str], sample_time: float) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Solver and setting of each learner, and its options of a setup."""
    for steps in STEPS:
        yield PAPERS, f"steps {steps}", {"solver": PAPERS, "learn_s": steps * sample_time}
    for name in names:
        solver = find(name).load()
        for setting, rung in (("default", {}), ("tightest", solver.ladder(1.0)[-1])):
            text = setting_text({**solver.fixed_settings, **rung})
            yield name, setting, {"solver": name, "solver_options": {"setting": text}}


def cost_gap(learner: SelfLearningCompensator) -> float:
    """Exact relative cost gap of the weights learned last; NaN if there are none."""
    while learner.phase is Phase.LEARN:  # a run may end a block before the phase does
        learner.observe([0.0], [np.nan])
    if learner.problem is None or not learner.counts["hand_overs"]:
        return np.nan
    return prove(learner.problem, learner.learned_weights).cost_gap


def row(solver: str, setting: str, trial: Trial) -> dict[str, Any]:
    """Gap and error of a learner."""
    error = trial.errors.reshape(-1, trial.y.shape[1])[-trial.setup.period :]
    return {
        "solver": solver,
        "setting": setting,
        "name": PAPERS if solver == PAPERS else f"others, {setting}",
        "cost_gap": float(np.max([cost_gap(learner) for learner in trial.learners])),
        "rms_percent": float(np.sqrt(np.mean(error**2))),
    }


def figure(table: pd.DataFrame) -> Figure:
    """Draw the tracking error of each learner against its gap."""
    plot = Plot(
        Axis("drawn", "cost gap of the learned weights", log=True, format=".0e"),
        Axis("rms_percent", "RMS error, % of range", log=True),
        (Mark("point", "name", size=80.0),),
        ("solver", "setting", "cost_gap", "rms_percent"),
        dict(zip(table.name.unique(), PALETTE, strict=False)),
        height=320,
    )
    return Figure(
        "learning_accuracy",
        "Does the tracking error depend on the solver?",
        "RMS error of both axes over the last period of the staircase against the exact cost gap of the learned "
        "weights. Lower is better; a level row of points means that the gap makes no difference. Gaps below "
        f"{LEAST_GAP:g} are drawn at that value.",
        table[table.cost_gap.notna()].assign(drawn=table.cost_gap.clip(lower=LEAST_GAP)),
        [plot],
    )


def sentences(table: pd.DataFrame) -> Iterator[str]:
    """The learners near the least error and those farther away, then each."""
    least = table.rms_percent.min()
    near = table.rms_percent <= NOTICED * least
    yield (
        f"{near.sum()} of {len(table)} learners are within {100 * (NOTICED - 1):.0f} % of the least tracking error, "
        f"{1e3 * least / 100 * RANGE_UM:.0f} nm RMS, with cost gaps up to {table.cost_gap[near].max():.1e}; the others "
        f"have gaps of at least {table.cost_gap[~near].min():.1e}, or learned nothing."
    )
    for each in table.itertuples():
        yield f"{each.solver}, {each.setting}: cost gap {each.cost_gap:.1e}, RMS error {each.rms_percent:.4f} %."


def main() -> None:
    """Let every solver learn; the gains of the stage drift by ``--drift`` a second."""
    given = arguments(quick=False, seed=0, drift=0.0, solvers=SOLVERS)
    setup = setup_of(given, gain_drift_per_s=given.drift)
    table = pd.DataFrame(
        row(solver, setting, learned(replace(setup, **options)))
        for solver, setting, options in learners(given.solvers.split(","), setup.sample_time)
    )
    show(figure(table), sentences(table), given.out)


if __name__ == "__main__":
    main()
