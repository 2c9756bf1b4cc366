"""The characteristics of the three elementary operators, as they stand in the paper's Fig. 1."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bench.experiment.style import HINDSIGHT, LEARNED, PALE, REFERENCE, STRAIGHT, Exhibit
from piezo_model.operators import creep, dead_zone, play
from piezo_model.signals import decaying_triangle

THRESHOLD = 0.4
SAMPLE_TIME = 1e-3
DURATION_S = 4.0
RATES = (10.0, 1.0)
DEAD_ZONES = (-0.4, 0.0, 0.4)


def exhibit() -> Exhibit:
    """Draw play and dead zone against their inputs and creep against time."""
    x = decaying_triangle(duration_s=DURATION_S, sample_time=SAMPLE_TIME, low=-1.0, high=1.0, cycles=3, final_share=0.4)
    t = np.arange(x.size) * SAMPLE_TIME
    played = play(x, [THRESHOLD], [0.0])[0][:, 0]
    u = np.linspace(-1.0, 1.0, x.size)
    zones = dead_zone(u, DEAD_ZONES)
    step = np.where((t >= 0.2) & (t < 2.2), 1.0, 0.0)
    crept = creep(step, [THRESHOLD] * len(RATES), RATES, SAMPLE_TIME, [0.0] * len(RATES))[0]
    table = pd.DataFrame({"time_s": t, "play_input": x, "play_output": played, "dead_zone_input": u,
                          **{f"dead_zone_output_r{r:+g}": zones[:, i] for i, r in enumerate(DEAD_ZONES)},
                          "creep_input": step, **{f"creep_output_rate{a:g}": crept[:, i] for i, a in enumerate(RATES)}})

    def draw(figure: Figure) -> None:
        left, middle, right = figure.subplots(1, 3)
        left.plot(x, x, color=PALE)
        left.plot(x, played, color=LEARNED)
        left.annotate("", (THRESHOLD, 0.0), (0.0, 0.0), arrowprops={"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0})
        left.annotate("r", (0.5 * THRESHOLD, 0.04), ha="center")
        left.set(title="play $H_r$", xlabel="input x", ylabel="output", xlim=(-1.05, 1.05), ylim=(-1.05, 1.05))
        for i, (r, colour) in enumerate(zip(DEAD_ZONES, (STRAIGHT, PALE, LEARNED), strict=True)):
            middle.plot(u, zones[:, i], color=colour, label=f"r = {r:g}")
        middle.set(title="one-sided dead zone $S_r$", xlabel="input u", xlim=(-1.05, 1.05), ylim=(-1.05, 1.05))
        middle.legend(loc="upper left")
        right.plot(t, step, color=REFERENCE, lw=0.8, label="input x")
        for i, (a, colour) in enumerate(zip(RATES, (LEARNED, HINDSIGHT), strict=True)):
            right.plot(t, crept[:, i], color=colour, label=f"rate {a:g} /s")
        right.set(title=f"creep $K_r$, r = {THRESHOLD:g}", xlabel="time, s", xlim=(0.0, DURATION_S), ylim=(-1.05, 1.05))
        right.legend(loc="lower right")
        for axes in (left, middle):
            axes.set_aspect("equal")
        right.set_box_aspect(1.0)
        for axes in (left, middle, right):
            axes.set_yticks((-1.0, -0.5, 0.0, 0.5, 1.0))

    sentence = (f"After the input has left by 1 − r = {1.0 - THRESHOLD:g} and come back to 0, creep ends at r = {THRESHOLD:g} and "
                "not at 0: it has hysteresis of its own.")
    return Exhibit("fig1_operators", "Fig. 1: the elementary operators",
                   "Play and dead zone against their inputs, creep against time for a step of the input up and down.",
                   (sentence,), table, draw, 3.4)
