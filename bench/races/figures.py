"""The figures of a race."""

import pandas as pd

from bench.derived import pictures
from bench.derived.measurements import Measurements
from bench.report.report import INK, LEAST_GAP, ROW, Axis, Figure, Mark, Plot, best_lines
from solvers import Lane

TARGETS = (1e3, 1e0, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15)
GAPS = (LEAST_GAP / 20.0, 1e4)
"""Axis of the picture of work and precision, with room for the names."""
STAGES = {"update": "#56b4e9", "solve": "#0072b2"}


def figures(measurements: Measurements, summary: pd.DataFrame) -> list[Figure]:
    """All figures, work and precision first."""
    work, sizes, stages = pictures.work_precision(measurements), pictures.sizes(measurements), pictures.stages(summary)
    times = (0.4 * float(work.answer_us.min()), 1.6 * float(work.answer_us.max())) if len(work) else ()
    bars = stages.groupby(["lane", "view"]).name.nunique().groupby("lane").max()
    names = Mark("text", "name", where={"end": [True], "front": [True]})
    defaults = Mark("hollow", where={"is_default": [True], "front": [True]}, colour=INK, size=110.0)
    return [
        Figure(
            "work_precision",
            "Work and precision",
            "A line is a solver, called in its fastest way, over its settings from loose to tight: the worst "
            "relative cost gap or violation of first and timed answers over all problems, against the median time. "
            "Lower is more exact, left is faster; left of the dashed line, the shortest sampling period, an answer "
            "is there before the next sample. Named are the paper's method at a step a sample, our exact solver and"
            " the libraries that people know first. In a ring: what a library does by default. Gaps below 1e-17 and"
            " above 1e3 are drawn at these.",
            work,
            [
                Plot(
                    Axis("answer_us", "time for one answer: update and solve, µs", log=True, domain=times),
                    Axis("drawn", "worst relative gap", log=True, format=".0e", values=TARGETS, domain=GAPS),
                    (*best_lines(points=True, along="rung"), defaults, names),
                    ("name", "lane", "settings", "worst_gap", "answer_us", "problems"),
                    rules={"x": measurements.shortest_period_us},
                    height=460,
                    legend=False,
                )
            ],
        ),
        Figure(
            "performance_profile",
            "Performance profile",
            "ρ(τ): the share of problems that a solver answers right to 1e-9 within τ times the time of the fastest "
            f"right answer (Dolan and Moré 2002), with one setting for all problems, of the {pictures.MOST_IN_PROFILE} "
            "with the least τ in the geometric mean. Higher is better; the left end says how often it is the fastest, "
            "the right end how often it is right.",
            pictures.performance_profile(measurements),
            [
                Plot(
                    Axis("factor", "τ: times as long as the fastest", log=True),
                    Axis("share", "ρ(τ): share of the problems answered right", format="%", domain=(0.0, 1.0)),
                    (Mark("step", "name"),),
                )
            ],
        ),
        Figure(
            "sizes",
            "Time by size",
            "Median time of update and solve by number of unknowns, where every answer of that size was right to 1e-9. "
            "The dashed line is the shortest sampling period. In colour: those that are right at all sizes and the "
            "fastest in the geometric mean.",
            sizes,
            [
                Plot(
                    Axis("d", "unknowns d", log=True, values=sorted(set(sizes.d.tolist()))),
                    Axis("time_us", "time for one answer, µs (update and solve)", log=True),
                    best_lines(points=True, along="d"),
                    ("name", "d", "time_us", "problems"),
                    rules={"y": measurements.shortest_period_us},
                )
            ],
        ),
        Figure(
            "stages",
            "Where the time goes",
            f"Medians over the problems of what each part takes, for the fastest {pictures.MOST_BARS} of each lane at "
            "the most exact tier that it reaches. The time beside a name is update and solve, which every answer "
            "costs; set-up, paid once, is in the table.",
            stages,
            [
                Plot(
                    Axis("us", f"share of time, lane {lane}", format="%"),
                    Axis("label"),
                    (Mark("bar", "stage", share=True, along="at"),),
                    ("name", "stage", "us"),
                    STAGES,
                    height=30 + ROW * int(bars[lane]),
                    where={"lane": [lane], "stage": [*STAGES]},
                )
                for lane in Lane
                if lane in bars.index
            ],
        ),
    ]
