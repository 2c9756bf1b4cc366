"""The interactive plots of a one-shot race."""

from __future__ import annotations

import altair as alt
import numpy as np
import pandas as pd

from bench.races.oneshot.plot_data import FULL_SOLVE, PAPERS_PACE, STAGES
from bench.report.charts import (
    LANES,
    LEAST_GAP,
    PALETTE,
    ROW,
    SHAPES,
    data,
    duration,
    finished,
    lane_scale,
    lines,
    log,
    named,
    names_beside,
    views,
)
from bench.timing.schedule import PERIOD_US

MOST_BARS = 24


def accuracy(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """The picture of the project: worst cost gap against time, with the sampling period as a line."""
    table = table.assign(drawn=np.maximum(table.worst_cost_gap, LEAST_GAP), period=PERIOD_US)
    solved = table[table.pace == FULL_SOLVE]
    table["named"] = pd.Series(named(solved, "total_us", "drawn"), index=solved.index).reindex(table.index, fill_value="")
    paced = table[table.pace == PAPERS_PACE]
    table["first"] = table.total_us == paced.groupby(["view", "solver"]).total_us.transform("min").reindex(table.index)
    source, lane = data(table), alt.selection_point(fields=["lane"], bind="legend")
    tips = [alt.Tooltip(f"{name}:N") for name in ("solver", "lane", "tier", "settings")] + [
        alt.Tooltip("worst_cost_gap:Q", format=".1e", title="worst cost gap"),
        alt.Tooltip("total_us:Q", format=".3~g", title="update and solve, µs"), alt.Tooltip("right:Q"),
        alt.Tooltip("problems:Q")]
    base = alt.Chart(source).encode(
        x=alt.X(**log("total_us", "update and solve, µs", table.total_us)),
        y=alt.Y(**log("drawn", "worst relative cost gap to the certified optimum", table.drawn, power_of_ten=True)))
    points = base.transform_filter(f"datum.pace == '{FULL_SOLVE}'").mark_point(filled=True, size=70).encode(
        color=alt.Color("lane:N", scale=lane_scale(table, LANES)),
        shape=alt.Shape("lane:N", scale=lane_scale(table, SHAPES)), tooltip=tips,
        opacity=alt.condition(lane, alt.value(0.9), alt.value(0.08))).add_params(lane)
    steps = base.transform_filter(f"datum.pace == '{PAPERS_PACE}'").mark_line(
        strokeWidth=1.5, point={"size": 25, "color": PALETTE[5]}, color=PALETTE[5]).encode(
        detail="solver:N", order="total_us:Q", tooltip=tips)
    paces = base.transform_filter("datum.first").mark_text(align="left", dx=8, dy=4).encode(text="label:N").transform_calculate(
        label=f"datum.solver + ', {PAPERS_PACE}'")
    rule = alt.Chart(source).mark_rule(strokeDash=[5, 4]).encode(x="min(period):Q")
    word = alt.Chart(source).mark_text(align="right", dx=-4, baseline="top").encode(
        x="min(period):Q", y=alt.value(2), text=alt.value(f"sampling period, {PERIOD_US:g} µs"))
    return [finished(alt.layer(rule, word, *([steps, paces] if len(paced) else []), points, *names_beside(base)), views(table), 460)]


def performance_profile(table: pd.DataFrame) -> list[alt.TopLevelMixin]:
    """ρ(τ) of each solver lane."""
    return lines(table, alt.X(**log("factor", "τ: times as long as the fastest", table.factor)),
                 alt.Y("share:Q", title="ρ(τ): share of the problems answered right", axis=alt.Axis(format="%", tickCount=5),
                       scale=alt.Scale(domain=[0, 1])),
                 [alt.Tooltip("name:N"), alt.Tooltip("factor:Q", format=".3~g"), alt.Tooltip("share:Q", format=".0%")],
                 "share", log_y=False, step=True)


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
            f"{solver}, {duration(us)}" for solver, us in zip(shown.solver, shown.update_and_solve_us, strict=True)])
        with_setup = alt.param(name="with_setup", value=False, bind=alt.binding_checkbox(name="with the set-up, paid once "))
        bars = alt.Chart(data(shown)).transform_filter(f"with_setup || datum.stage != '{STAGES[0]}'").mark_bar().encode(
            y=alt.Y("label:N", title=None, axis=alt.Axis(labelLimit=220), sort=alt.EncodingSortField(
                "update_and_solve_us", op="min")),
            x=alt.X("us:Q", stack="normalize", title=f"share of time, lane {lane}",
                    axis=alt.Axis(format="%", tickCount=5)),
            color=alt.Color("stage:N", scale=alt.Scale(domain=[*STAGES], range=["#999999", "#56b4e9", "#0072b2", "#e69f00"]),
                            legend=alt.Legend(columns=2)),
            order="at:O", tooltip=[alt.Tooltip("name:N"), alt.Tooltip("stage:N"), alt.Tooltip("us:Q", format=".3~g")])
        count = int(shown.groupby("view").name.nunique().max())
        charts.append(finished(bars.add_params(with_setup), views(shown), 30 + ROW * count))
    return charts
