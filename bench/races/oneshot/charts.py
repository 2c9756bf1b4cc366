"""The interactive plots of a one-shot race."""

from __future__ import annotations

import altair as alt
import numpy as np
import pandas as pd

from bench.derived.pictures import OTHER_LINES, OUR_LINES, STAGES
from bench.derived.ranking import PACE
from bench.report.charts import (
    LANES,
    LEAST_GAP,
    ROW,
    data,
    duration,
    finished,
    lines,
    log,
    named,
    names_beside,
    views,
)
from bench.report.words import marked
from bench.timing.schedule import PERIOD_US

MOST_BARS = 24
MOST_GAP = 1e3
"""Cost gaps above this are drawn at it."""
TICKS = [1e3, 1e0, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15]
"""Grid lines at the targets."""
WHOSE = {PACE: "#d55e00", OUR_LINES: "#1f86c7", OTHER_LINES: "#8a8f98"}
"""Colours of the lines by who made the solver."""


def work_precision(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """The picture of the project: worst cost gap against time, a line a solver over its rungs, with the targets and the sampling period."""
    table = table.assign(drawn=np.clip(table.worst_cost_gap, LEAST_GAP, MOST_GAP), period=PERIOD_US)
    ends = table.groupby(["view", "name"]).drawn.transform("min") == table.drawn
    last = table[ends].drop_duplicates(["view", "name"])
    table["named"] = pd.Series(named(last, "total_us", "drawn", "name", wide=480), index=last.index).reindex(table.index, fill_value="")
    source = data(table)  # one for all layers, or the choice of the view would not reach some
    y = {**log("drawn", "worst relative cost gap", table.drawn), "axis": alt.Axis(values=TICKS, format=".0e", gridOpacity=0.35)}
    near = alt.selection_point(fields=["name"], on="pointerover", nearest=True, empty=False, clear="pointerout")
    whose = [who for who in WHOSE if (table.who == who).any()]
    group = alt.selection_point(fields=["who"], bind="legend")
    sought = alt.param(name="sought", value="", bind=alt.binding(input="search", name="Find a solver ", placeholder="name"))
    base = alt.Chart(source).transform_filter("indexof(lower(datum.name), lower(sought)) >= 0").encode(
        x=alt.X(**log("total_us", "time for one answer: update and solve, µs", table.total_us)),
        y=alt.Y(**y), color=alt.Color("who:N", scale=alt.Scale(domain=whose, range=[WHOSE[who] for who in whose])),
        opacity=alt.when(near).then(alt.value(1.0)).when(group).then(alt.value(0.9)).otherwise(alt.value(0.06)))
    tips = [alt.Tooltip(f"{name}:N") for name in ("name", "lane", "rung", "settings")] + [
        alt.Tooltip("worst_cost_gap:Q", format=".1e", title="worst cost gap"),
        alt.Tooltip("total_us:Q", format=".3~g", title="update and solve, µs"), alt.Tooltip("problems:Q")]
    lines_of_rungs = base.transform_filter("datum.rung >= 0").mark_line().encode(
        detail="name:N", order="rung:Q", strokeWidth=alt.when(near).then(alt.value(4)).otherwise(alt.value(1.5))).add_params(group)
    points = base.transform_filter("!datum.is_default").mark_point(filled=True, size=45).encode(tooltip=tips).add_params(near)
    hollow = base.transform_filter("datum.is_default").mark_point(filled=False, size=60, strokeWidth=2).encode(tooltip=tips)
    period = alt.Chart(source).mark_rule(strokeDash=[5, 4]).encode(x="min(period):Q")
    word = alt.Chart(source).mark_text(baseline="bottom").encode(
        x="min(period):Q", y=alt.value(-3), text=alt.value(f"sampling period, {PERIOD_US:g} µs"))
    return [finished(alt.layer(period, word, lines_of_rungs, points, hollow, *names_beside(base, "name", 420)).add_params(sought), views(table), 460)]


def performance_profile(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """ρ(τ) of each solver lane."""
    return lines(table, alt.X(**log("factor", "τ: times as long as the fastest", table.factor)),
                 alt.Y("share:Q", title="ρ(τ): share of the problems answered right", axis=alt.Axis(format="%", tickCount=5),
                       scale=alt.Scale(domain=[0, 1])),
                 [alt.Tooltip("name:N"), alt.Tooltip("factor:Q", format=".3~g"), alt.Tooltip("share:Q", format=".0%")],
                 "share", log_y=False, step=True)


def anytime(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Gap within a budget of sampling periods."""
    table = table[np.isfinite(table.median_gap)].assign(drawn=lambda known: np.maximum(known.median_gap, LEAST_GAP))
    if table.empty:
        return []
    table = table.assign(name=table.name + " (" + table.lane + ")")
    return lines(table, alt.X(**log("budget", f"sampling periods of {PERIOD_US:g} µs", table.budget)),
                 alt.Y(**log("drawn", "relative cost gap within them, median over the problems", table.drawn, power_of_ten=True)),
                 [alt.Tooltip("name:N"), alt.Tooltip("budget:Q"), alt.Tooltip("median_gap:Q", format=".1e"),
                  alt.Tooltip("worst_gap:Q", format=".1e")], "drawn", log_y=True, step=True)


def sizes(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Time against the number of unknowns."""
    x = alt.X("d:Q", scale=alt.Scale(type="log", nice=False, padding=8), title="unknowns d",
              axis=alt.Axis(values=sorted(set(table.d.tolist())), labelOverlap=True, format="d"))
    return lines(table.sort_values("d"), x,
                 alt.Y(**log("time_us", "time for one answer, µs (update and solve)", table.time_us)),
                 [alt.Tooltip("name:N"), alt.Tooltip("d:Q"), alt.Tooltip("time_us:Q", format=".3~g", title="µs"),
                  alt.Tooltip("problems:Q")], "time_us", log_y=True, deadline=True)


def stages(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """Stacked shares of an answer's time, one plot a lane; set-up, paid once, is added on request."""
    charts = []
    for lane in [lane for lane in LANES if (table.lane == lane).any()]:
        part = table[table.lane == lane]
        shown = part[part.groupby("view").update_and_solve_us.rank(method="dense") <= MOST_BARS]
        shown = shown.assign(at=shown.stage.map(STAGES.index), label=[
            f"{marked(solver)}, {duration(us)}" for solver, us in zip(shown.solver, shown.update_and_solve_us, strict=True)])
        with_setup = alt.param(name="with_setup", value=False, bind=alt.binding_checkbox(name="with the set-up, paid once "))
        bars = alt.Chart(data(shown)).transform_filter(f"with_setup || datum.stage != '{STAGES[0]}'").mark_bar().encode(
            y=alt.Y("label:N", title=None, axis=alt.Axis(labelLimit=220), sort=alt.EncodingSortField(
                "update_and_solve_us", op="min")),
            x=alt.X("us:Q", stack="normalize", title=f"share of time, lane {lane}",
                    axis=alt.Axis(format="%", tickCount=5)),
            color=alt.Color("stage:N", scale=alt.Scale(domain=[*STAGES], range=["#999999", "#56b4e9", "#0072b2"]),
                            legend=alt.Legend(columns=2)),
            order="at:O", tooltip=[alt.Tooltip("name:N"), alt.Tooltip("stage:N"), alt.Tooltip("us:Q", format=".3~g")])
        count = int(shown.groupby("view").name.nunique().max())
        charts.append(finished(bars.add_params(with_setup), views(shown), 30 + ROW * count))
    return charts
