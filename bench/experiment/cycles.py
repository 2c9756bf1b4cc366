"""Error against cycle number, on a stage that stays as it is and on one that drifts.

A compensator that was made once, before the start-up, is the paper's reason for learning while running: it disregards
temperature and ageing. On the drifting stage it is what learns for two cycles and keeps that model.
"""

from __future__ import annotations

from dataclasses import replace

import altair as alt
import numpy as np
import pandas as pd

from bench.experiment.plots import HINDSIGHT, LEARNED, OTHER, STRAIGHT, Exhibit, Line, axis, beside, plot
from bench.rig.rig import AXES
from bench.rig.trial import Trial, learned, learned_once

DRIFT_PER_CYCLE = 5e-3
"""Change of the actuators' gain in one cycle."""
ONCE = 2
"""Cycles after which the fixed compensator stops learning."""


def per_cycle(trial: Trial) -> np.ndarray:
    """RMS error of every cycle in percent of range, both axes taken together, shape (cycles,)."""
    return np.array([np.sqrt(np.mean(trial.rms_percent(c) ** 2)) for c in range(trial.rig.cycles)])


def exhibit(straight: Trial, hindsight: Trial, still: Trial) -> Exhibit:
    """Draw the errors of the three runs on the still stage and of two on a drifting one."""
    rig = still.rig
    drifting = replace(rig, gain_drift_per_s=DRIFT_PER_CYCLE / (rig.cycle * rig.sample_time), cycles=max(rig.cycles, ONCE + 2))
    errors = {"straight": per_cycle(straight), "hindsight": per_cycle(hindsight), "learned": per_cycle(still),
              "learned_drifting": per_cycle(learned(drifting)), "learned_once_drifting": per_cycle(learned_once(drifting, ONCE))}
    number = np.arange(1, drifting.cycles + 1)
    table = pd.DataFrame({"cycle": number, **{f"{key}_percent": pd.Series(values) for key, values in errors.items()}})

    def panel(title: str, *keys: tuple[str, str, str, str]) -> alt.TopLevelMixin:
        return plot([Line(label, np.arange(1, errors[key].size + 1), errors[key], colour, shape=shape)
                     for key, colour, label, shape in keys],
                    {**axis("cycle", domain=[0.8, drifting.cycles + 0.2]), "axis": alt.Axis(values=number.tolist(), format="d")},
                    axis("RMS error, % of range", type="log", padding=8), 340, 230, title)

    chart = beside(
        panel("stage that stays as it is", ("straight", STRAIGHT, "straight line", "circle"),
              ("hindsight", HINDSIGHT, "best straight line with hindsight", "triangle-up"),
              ("learned", LEARNED, "self-learning", "square")),
        panel(f"actuators whose gain drifts by {100 * DRIFT_PER_CYCLE:g} % a cycle",
              ("learned_once_drifting", OTHER, f"learned for {ONCE} cycles, then fixed", "diamond"),
              ("learned_drifting", LEARNED, "self-learning", "square")), y="shared")
    e = {key: float(values[-1]) for key, values in errors.items()}
    settled = int(np.argmax(errors["learned"] <= 2.0 * errors["learned"].min())) + 1
    sentences = (f"Both axes together: from {errors['learned'][0]:.2f} % in cycle 1, in which nothing is known, to "
                 f"{e['learned']:.3f} % in cycle {rig.cycles}; cycle {settled} is the first within twice the best.",
                 f"Where the gain drifts by {100 * DRIFT_PER_CYCLE:g} % a cycle, a compensator that stopped learning after "
                 f"{ONCE} cycles is at {e['learned_once_drifting']:.2f} % in cycle {drifting.cycles} and the one that learns "
                 f"on at {e['learned_drifting']:.2f} %.")
    return Exhibit("cycles", "Error against cycle number",
                   f"RMS error of axes {' and '.join(AXES)} together in each cycle; weights are handed over where a cycle ends.",
                   sentences, table, chart)
