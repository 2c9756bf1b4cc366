"""The figures of a race."""

import numpy as np
import pandas as pd

from bench.derived import pictures
from bench.derived.measurements import Measurements
from bench.report.report import INK, Axis, Figure, Mark, Plot, best_lines
from bench.report.words import joined

WIDTH, HEIGHT, LETTER, LINE = 230.0, 460, 6.6, 13.0
"""Pixels of the picture of work and precision on a phone, between its axes, and of a letter of a name in it."""


def figures(measurements: Measurements) -> list[Figure]:
    """All figures, work and precision first."""
    sizes, work = pictures.sizes(measurements), pictures.work_precision(measurements)
    times, gaps = around(pd.Series([*work.answer_us, measurements.shortest_period_us])), around(work.drawn)
    missing = joined(sorted({*measurements.own} - {*work.name}))
    return [
        Figure(
            "work_precision",
            "Work and precision",
            "A line is a solver, called in its fastest way, over its settings from loose to tight: the worst "
            "relative cost gap or violation of first and timed answers over all problems, against the median time. "
            "Lower is more exact, left is faster; left of the dashed line, the shortest sampling period, an answer "
            f"is there before the next sample. Named are the {pictures.NAMED} best of the table, your own and the "
            "paper's method at a step a sample, each at the setting by which the table ranks it; a touch names any "
            "other. In a ring: what a library does by default. Gaps below 1e-17 and above 1e3, where an answer is "
            f"missing too, are drawn at these.{f' Not drawn, since they have no time: {missing}.' if missing else ''}",
            apart(work, times, gaps),
            [
                Plot(
                    Axis("answer_us", "time for one answer: update and solve, µs", log=True, domain=times),
                    Axis("drawn", "worst relative gap", log=True, format=".0e", domain=gaps),
                    (
                        *best_lines("rung"),
                        Mark("hollow", where={"is_default": [True], "front": [True]}, colour=INK, size=110.0),
                        Mark("text", "name", where={"end": [True], "front": [True]}),
                    ),
                    ("name", "lane", "settings", "worst_gap", "answer_us", "problems"),
                    rules={"x": measurements.shortest_period_us},
                    height=HEIGHT,
                )
            ],
        ),
        Figure(
            "performance_profile",
            "Performance profile",
            "ρ(τ): the share of problems that a solver answers right to 1e-9 within τ times the time of the fastest "
            f"right answer (Dolan and Moré 2002), with one setting for all problems, of the {pictures.MOST_IN_PROFILE} "
            "with the least τ in the geometric mean, and of yours. Higher is better; the left end says how often it is "
            "the fastest, the right end how often it is right.",
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
            "fastest in the geometric mean, and yours.",
            sizes,
            [
                Plot(
                    Axis("d", "unknowns d", log=True),
                    Axis("time_us", "time for one answer, µs (update and solve)", log=True),
                    best_lines("d"),
                    ("name", "d", "time_us", "problems"),
                    rules={"y": measurements.shortest_period_us},
                )
            ],
        ),
    ]


def around(values: pd.Series) -> tuple[float, float]:
    """A logarithmic axis about these values, over a decade at least.

    Examples
    --------
    >>> around(pd.Series([1.0, 1e8]))
    (0.1, 1000000000.0)
    """
    low, high = np.log10([values.min(), values.max()]) if len(values) else (0.0, 0.0)
    room = max(high - low, 1.0) / 8.0
    return float(10.0 ** (low - room)), float(10.0 ** (high + room))


def apart(work: pd.DataFrame, times: tuple[float, float], gaps: tuple[float, float]) -> pd.DataFrame:
    """The table with ``dx`` and ``dy``, how far beside and below its point a name stands in pixels, above it if that is
    negative, so that on a phone names are within the picture and none covers another."""
    x, y = (
        pixels * np.log(values / low) / np.log(high / low)
        for pixels, values, (low, high) in ((WIDTH, work.answer_us, times), (-HEIGHT, work.drawn, gaps))
    )
    half = LETTER / 2.0 * work.name.str.len()
    work = work.assign(dx=x.clip(half, WIDTH - half) - x, dy=LINE)
    shifts = [shift for k in range(len(work)) for shift in (LINE * (k + 1.0), -LINE * (k + 0.6))]
    for _, names in work[work.front & work.end].assign(y=y).sort_values(["y", "answer_us"]).groupby("view"):
        for k, i in enumerate(names.index):
            others = names.index[:k]
            others = others[((x + work.dx)[others] - x[i] - work.dx[i]).abs() < half[others] + half[i]]
            distances = (y + work.dy)[others] - y[i]
            work.loc[i, "dy"] = next(shift for shift in shifts if ((distances - shift).abs() >= LINE).all())
    return work
