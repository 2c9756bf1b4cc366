"""The characteristics of the three elementary operators, the paper's Fig. 1."""

import numpy as np
import pandas as pd
from outputs import arguments, show

from bench.report.report import GREY, PALETTE, Axis, Figure, Mark, Plot
from piezo_model.operators import creep, dead_zone, play
from piezo_model.signals import decaying_triangle

THRESHOLD = 0.4
SAMPLE_TIME = 1e-3
RATES = (10.0, 1.0)
DEAD_ZONES = (-0.4, 0.0, 0.4)
BLUE, RED = PALETTE[:2]


def figure() -> Figure:
    """Play and dead zone against their inputs, and creep against time."""
    x = decaying_triangle(duration_s=4.0, sample_time=SAMPLE_TIME, low=-1.0, high=1.0, cycles=3, final_share=0.4)
    t = np.arange(x.size) * SAMPLE_TIME
    u, step = np.linspace(-1.0, 1.0, x.size), np.where((t >= 0.2) & (t < 2.2), 1.0, 0.0)
    played, zones = play(x, [THRESHOLD], [0.0])[0], dead_zone(u, DEAD_ZONES)
    crept = creep(step, [THRESHOLD] * len(RATES), RATES, SAMPLE_TIME, [0.0] * len(RATES))[0]
    lines = [
        ("play", f"r = {THRESHOLD:g}", x, played[:, 0]),
        *(("zone", f"r = {r:+g}", u, zones[:, i]) for i, r in enumerate(DEAD_ZONES)),
        ("creep", "input", step, step),
        *(("creep", f"rate {rate:g} /s", step, crept[:, i]) for i, rate in enumerate(RATES)),
    ]
    table = pd.concat(
        [
            pd.DataFrame({"operator": operator, "name": name, "time_s": t, "input": given, "output": output})[::4]
            for operator, name, given, output in lines
        ],
        ignore_index=True,
    )
    time, given, output = Axis("time_s", "time, s"), Axis("input", "input"), Axis("output", "output")
    by_name = (Mark("line", "name", along="time_s"),)
    return Figure(
        "fig1_operators",
        "Fig. 1: the elementary operators",
        "Play H and one-sided dead zones S against their inputs, creep K against time for a step of the "
        "input up and down.",
        table,
        [
            Plot(given, output, by_name, where={"operator": ["play"]}, colours={lines[0][1]: BLUE}, height=260),
            Plot(given, output, by_name, where={"operator": ["zone"]}, height=260),
            Plot(
                time,
                output,
                by_name,
                where={"operator": ["creep"]},
                height=260,
                colours=dict(zip(("input", *(f"rate {rate:g} /s" for rate in RATES)), (GREY, BLUE, RED), strict=True)),
            ),
        ],
    )


def main() -> None:
    """Draw the figure."""
    show(
        figure(),
        [
            f"After the input has left by 1 − r = {1.0 - THRESHOLD:g} and come back to 0, creep ends at r = "
            f"{THRESHOLD:g} and "
            "not at 0: it has hysteresis of its own."
        ],
        arguments().out,
    )


if __name__ == "__main__":
    main()
