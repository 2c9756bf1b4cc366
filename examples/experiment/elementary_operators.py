"""The characteristics of the three elementary operators, the paper's Fig. 1."""

from __future__ import annotations

import altair as alt
import numpy as np
import pandas as pd
from outputs import arguments, show

from bench.experiment.plots import HINDSIGHT, LEARNED, PALE, REFERENCE, STRAIGHT, Line, axis, beside, plot
from bench.report.charts import data
from bench.report.report import Figure
from piezo_model.operators import creep, dead_zone, play
from piezo_model.signals import decaying_triangle

THRESHOLD = 0.4
SAMPLE_TIME = 1e-3
DURATION_S = 4.0
RATES = (10.0, 1.0)
DEAD_ZONES = (-0.4, 0.0, 0.4)
SIDE = 220
"""Of each plot, pixels."""


def figure() -> Figure:
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

    within = {"domain": [-1.05, 1.05]}
    outputs = axis("output", **within)
    threshold = pd.DataFrame({"x": [0.0, THRESHOLD], "y": 0.0, "shape": ["triangle-left", "triangle-right"]})
    ends = alt.Chart(data(threshold)).encode(x="x:Q", y="y:Q")
    letter = alt.Chart(data(pd.DataFrame({"x": [0.5 * THRESHOLD], "y": 0.0}))).encode(x="x:Q", y="y:Q")
    chart = beside(
        alt.layer(plot([Line("input", x, x, PALE), Line("output", x, played, LEARNED)], axis("input x", **within), outputs,
                       SIDE, SIDE, "play H, threshold r", legend=False),
                  ends.mark_line(color=REFERENCE, strokeWidth=1.0),
                  ends.mark_point(filled=True, color=REFERENCE, opacity=1.0).encode(shape=alt.Shape("shape:N", scale=None)),
                  letter.mark_text(dy=-9).encode(text=alt.value("r"))),
        plot([Line(f"r = {r:g}", u, zones[:, i], colour)
              for i, (r, colour) in enumerate(zip(DEAD_ZONES, (STRAIGHT, PALE, LEARNED), strict=True))],
             axis("input u", **within), outputs, SIDE, SIDE, "one-sided dead zone S, threshold r"),
        plot([Line("input x", t, step, REFERENCE, width=0.8),
              *(Line(f"rate {a:g} /s", t, crept[:, i], colour)
                for i, (a, colour) in enumerate(zip(RATES, (LEARNED, HINDSIGHT), strict=True)))],
             axis("time, s", domain=[0.0, DURATION_S]), outputs, SIDE, SIDE, f"creep K, threshold r = {THRESHOLD:g}"))
    return Figure("fig1_operators", "Fig. 1: the elementary operators",
                  "Play and dead zone against their inputs, creep against time for a step of the input up and down.", table, [chart])


def main() -> None:
    """Draw them."""
    show(figure(), [f"After the input has left by 1 − r = {1.0 - THRESHOLD:g} and come back to 0, creep ends at r = {THRESHOLD:g} and "
                    "not at 0: it has hysteresis of its own."], arguments().out)


if __name__ == "__main__":
    main()
