"""The page of one recording: its loops measured and modelled, the error over time, the weights, what is left over, and advice."""

from __future__ import annotations

from pathlib import Path

import altair as alt
import numpy as np
import pandas as pd

from bench.report import charts
from bench.report.page import save
from bench.report.report import Figure, Table
from piezo_model.identification.fit_review import Review

POINTS = 2_500
"""Most points of a line."""
BLUE, RED = charts.PALETTE[:2]


def write(path: Path, name: str, review: Review) -> Path:
    """Write the page and ``<page>-figures/*.csv`` beside it; returns its path."""
    s = review.model.structure
    units = tuple(unit.replace("um", "µm") for unit in (s.input_unit, s.output_unit))
    figures = [
        Figure("loops", "Loops, measured and modelled", "Output against input over the counted part of the recording.",
               *_loops(review, *units)),
        Figure("error", "Error over time", "Measured minus modelled output, lowest and highest of each stretch of time. A "
               "grey part at the start is not counted; the axis ends at twice the largest counted error.",
               *_error(review, units[1])),
        Figure("weights", "Weights", "In unit amplitudes with w_H0 = 1. Bars are 95 % intervals, corrected for the memory of the "
               "residual; a weight without one stands at its bound or was never reached. Excitation is the RMS of the operator's "
               "signal: a weight whose operator hardly moves is hardly known.", *_weights(review)),
        Figure("spectrum", "What is left over", "Amplitude density of the error by Welch's method. Level: noise; rising to the "
               "left: something slow that the model misses; a peak: a resonance or a hum.", *_spectrum(review, units[1]))]
    grids = []
    if (selection := review.model.report.get("selection")) and review.fitted:
        rows = [[str(c["n"]), str(c["m"]), ", ".join(f"{rate:.3g}" for rate in c["creep_rates"]), str(c["d"]), f"{c['error_percent']:.4f}",
                 f"{c['standard_error']:.4f}", c["standing"]] for c in selection["table"]]
        headings = ("n", "m", "creep rates, 1/s", "unknowns", "error of the drive on data left out, % of range", "standard error", "")
        grids.append(Table("Orders and creep rates by cross-validation", headings, rows, 0, note=selection["sentence"]))
    return save(path, "recording.html.jinja", figures, f"{path.stem}-figures", title=f"Recording {name}",
                advice=list(review.advice()), sentences=list(review.sentences), grids=grids)


def _thinned(size: int) -> np.ndarray:
    return np.unique(np.linspace(0, size - 1, min(size, POINTS)).astype(int))


def _loops(review: Review, input_unit: str, output_unit: str) -> tuple[pd.DataFrame, list[alt.TopLevelMixin]]:
    at = review.skipped + _thinned(review.x.size - review.skipped)
    table = pd.concat([pd.DataFrame({"sample": at, "x": review.x[at], "y": values[at], "what": what})
                       for what, values in (("measured", review.y), ("modelled", review.y_model))], ignore_index=True)
    what = alt.Color("what:N", scale=alt.Scale(domain=["measured", "modelled"], range=[BLUE, RED]))
    plot = alt.Chart(charts.data(table)).mark_line().encode(
        x=alt.X("x:Q", title=f"input, {input_unit}", scale=alt.Scale(zero=False)), order="sample:Q", color=what,
        y=alt.Y("y:Q", title=f"output, {output_unit}", scale=alt.Scale(zero=False)),
        size=alt.condition("datum.what == 'measured'", alt.value(3.5), alt.value(0.9)),
        opacity=alt.condition("datum.what == 'measured'", alt.value(0.45), alt.value(1.0)))
    return table, [charts.finished(plot, None, 420)]


def _error(review: Review, unit: str) -> tuple[pd.DataFrame, list[alt.TopLevelMixin]]:
    e = review.error
    edges = np.unique(np.linspace(0, e.size, min(e.size, POINTS // 2) + 1).astype(int))
    table = pd.DataFrame({"time_s": edges[:-1] * review.model.structure.sample_time, "lowest": np.minimum.reduceat(e, edges[:-1]),
                          "highest": np.maximum.reduceat(e, edges[:-1]), "counted": edges[:-1] >= review.skipped})
    end = 2.0 * np.abs(e[review.skipped:]).max()  # a transient would leave a flat line of the rest
    lowest, highest = max(e.min(), -end), min(e.max(), end)
    plot = alt.Chart(charts.data(table)).mark_rule(strokeWidth=1.5, strokeCap="round", clip=True).encode(
        x=alt.X("time_s:Q", title="time, s"), y2="highest:Q",
        y=alt.Y("lowest:Q", title=f"error, {unit}", scale=alt.Scale(domain=[lowest, highest])),
        color=alt.Color("counted:N", scale=alt.Scale(domain=[True, False], range=[BLUE, "#999999"]),
                        legend=alt.Legend(title=None, labelExpr="datum.value ? 'counted' : 'not counted'")))
    return table, [charts.finished(plot, None, 260)]


def _weights(review: Review) -> tuple[pd.DataFrame, list[alt.TopLevelMixin]]:
    rows = [{"weight": w.name, "value": w.value, "low": w.value - w.half_width, "high": w.value + w.half_width,
             "excitation": w.excitation, "standing": "never reached" if not w.reached else "at its bound" if w.at_bound else "free"}
            for w in review.weights]
    table = pd.DataFrame(rows)
    order = [w.name for w in review.weights]
    source = charts.data(table)
    base = alt.Chart(source).encode(y=alt.Y("weight:N", sort=order, title=None))
    tips = [alt.Tooltip("weight:N"), alt.Tooltip("standing:N"), *(alt.Tooltip(f"{name}:Q", format=".4g") for name in (
        "value", "low", "high", "excitation"))]
    bars = base.transform_filter("datum.low != null").mark_rule(strokeWidth=3, opacity=0.5, color=BLUE).encode(
        x="low:Q", x2="high:Q")
    standing = ["free", "at its bound", "never reached"]
    points = base.mark_point(filled=True, size=70).encode(
        x=alt.X("value:Q", title="weight, unit amplitudes"), tooltip=tips,
        color=alt.Color("standing:N", scale=alt.Scale(domain=standing, range=[BLUE, "#e69f00", RED])),
        shape=alt.Shape("standing:N", scale=alt.Scale(domain=standing, range=["circle", "square", "cross"])))
    excitation = alt.Chart(source).mark_bar(color=charts.PALETTE[2]).encode(
        y=alt.Y("weight:N", sort=order, title=None), tooltip=tips,
        x=alt.X("excitation:Q", title="excitation, RMS in unit amplitudes"))
    height = 30 + 18 * len(order)
    return table, [charts.finished(bars + points, None, height), charts.finished(excitation, None, height)]


def _spectrum(review: Review, unit: str) -> tuple[pd.DataFrame, list[alt.TopLevelMixin]]:
    f, density = review.spectrum()
    table = pd.DataFrame({"frequency_Hz": f, "density": density})
    table = table[table.density > 0.0]
    plot = alt.Chart(charts.data(table)).mark_line(strokeWidth=1.2, color=BLUE).encode(
        x=alt.X(**charts.log("frequency_Hz", "frequency, Hz", table.frequency_Hz)),
        y=alt.Y(**charts.log("density", f"error, {unit} per √Hz", table.density, power_of_ten=True)))
    return table, [charts.finished(plot, None, 300)]
