"""What interactive plots of tables are made of, as Vega-Lite specifications.

Made with Altair and drawn by Vega, both of the University of Washington's Interactive Data Lab and in use since 2013. Its
bundle of 0.9 MB comes offline in the package vl-convert-python (the one of plotly is 4.6 MB), a plot is a small declarative
text in which no code of ours runs, and it is drawn as SVG: text that takes the page's colours, light or dark, and prints
sharp. Colours are those of Okabe and Ito; lanes differ in shape and dash, too.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib.metadata import version
from typing import Any

import altair as alt
import numpy as np
import pandas as pd
import vl_convert

from bench.messages import user_cache
from bench.timing.schedule import PERIOD_US
from piezo_model.atomic_file import write_text

COLOURS = {"kernel": "#d55e00", "direct": "#0072b2", "qpsolvers": "#009e73", "cvxpy": "#cc79a7", "codegen": "#e69f00"}
"""Okabe and Ito's palette, which colour-blind readers can tell apart."""
LEAST_GAP = 1e-17
"""Cost gaps below this are drawn at it."""
NAMED = 4
"""Lines of a plot with many that carry their names."""
INK = "currentColor"
MACHINE = "the machine"
"""Stands among the lanes for the solver that does nothing."""
LANES = {**COLOURS, "direct": "#1f86c7", MACHINE: INK}
"""Okabe and Ito's blue is too dark to be read on a dark page; this one is read on both."""
DASHES = dict(zip(LANES, ([1, 0], [6, 3], [2, 2], [8, 2, 2, 2], [4, 4], [1, 0]), strict=True))
PALETTE = ["#1f86c7", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"]
HEIGHT = 380
ROW = 20
"""Height of one bar, pixels."""
CONFIG: dict[str, Any] = {
    "background": "transparent", "font": "system-ui, sans-serif", "view": {"stroke": None},
    "axis": {"labelColor": INK, "titleColor": INK, "domainColor": INK, "tickColor": INK, "gridColor": INK,
             "gridOpacity": 0.12, "titleFontWeight": "normal", "labelFontSize": 11, "titleFontSize": 12},
    "legend": {"labelColor": INK, "titleColor": INK, "orient": "top", "title": None, "labelFontSize": 12, "symbolSize": 80,
               "columns": 4},
    "header": {"labelColor": INK, "titleColor": INK}, "title": {"color": INK},
    "text": {"color": INK, "fontSize": 11}, "rule": {"color": INK}}


def library() -> str:
    """The JavaScript that draws, of the version that Altair writes for; it holds no end of a script element.

    It is kept where it can be, since to put it together takes longer than to write a page.
    """
    kept = user_cache.folder("vega") / f"{alt.SCHEMA_VERSION}-{version('vl-convert-python')}.js"
    with suppress(OSError):
        return kept.read_text(encoding="utf-8")
    bundle: str = vl_convert.javascript_bundle(vl_version=vega_lite_version())  # type: ignore[call-arg]
    bundle = bundle.replace("</script", "<\\/script")
    user_cache.keep(kept, partial(write_text, text=bundle))
    return bundle


def vega_lite_version() -> str:
    """The version that Altair writes for, as vl-convert calls it."""
    return alt.SCHEMA_VERSION.removeprefix("v").rpartition(".")[0]


def specification(chart: alt.TopLevelMixin) -> dict[str, Any]:
    """What the page hands to the library."""
    found: dict[str, Any] = chart.to_dict()
    found["config"] = CONFIG
    return found


def data(table: pd.DataFrame) -> alt.Data:
    """The table in the specification; what is not finite is null.

    As one text, which Vega reads: Altair copies and checks values one by one at every step of making a chart.
    """
    plain = table.astype(object).where(table.notna(), None).replace([np.inf, -np.inf], None)
    text = json.dumps(plain.to_dict("records"), ensure_ascii=False, allow_nan=False, default=np.generic.item)
    return alt.Data(values=text, format=alt.JsonDataFormat(type="json"))  # type: ignore[no-untyped-call]


def views(table: pd.DataFrame, column: str = "view", called: str = "Show ") -> alt.Parameter | None:
    """A choice between the views of a table; None for one view only."""
    names = list(dict.fromkeys(map(str, table[column])))
    if len(names) < 2:
        return None
    return alt.param(name=column, value=first_view(table, column), bind=alt.binding_select(options=names, name=called))


def first_view(table: pd.DataFrame, column: str = "view") -> str:
    """The view that is shown unasked, "" of an empty table or one without views."""
    if column not in table:
        return ""
    names = dict.fromkeys(map(str, table[column]))  # min takes the first of equals
    return min(names, key=lambda name: (not name.startswith("paper,"), "scaled" not in name), default="")


def finished(chart: Any, choice: alt.Parameter | None, height: int = HEIGHT) -> alt.TopLevelMixin:
    """The chart or layers of charts over the page's whole width; shows the view that is chosen."""
    if choice is not None:
        chart = chart.add_params(choice).transform_filter(f"datum.{choice.name} == {choice.name}")
    whole: alt.TopLevelMixin = chart.properties(width="container", height=height)
    return whole


def lane_scale(table: pd.DataFrame, values: Mapping[str, Any]) -> alt.Scale:
    """What stands for the lanes that a table holds."""
    lanes = [lane for lane in LANES if (table.lane == lane).any()]
    return alt.Scale(domain=lanes, range=[values[lane] for lane in lanes])


def together(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """The parts under each other, the first of which may have the columns alone."""
    whole = [part for part in parts if len(part)]
    return pd.concat(whole, ignore_index=True) if whole else parts[0]


def duration(us: float) -> str:
    """Microseconds for a reader.

    Examples
    --------
    >>> duration(2.705), duration(1860.0), duration(2.5e6)
    ('2.71 µs', '1.86 ms', '2.5 s')
    """
    factor, unit = next((factor, unit) for factor, unit in ((1e6, "s"), (1e3, "ms"), (0.0, "µs")) if us >= factor)
    return f"{us / (factor or 1.0):.3g} {unit}"


def log(field: str, title: str, values: pd.Series, power_of_ten: bool = False) -> dict[str, Any]:
    """Arguments of a logarithmic axis over these values, with lines where a reader counts."""
    known = values[np.isfinite(values.astype(float)) & (values > 0.0)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (1.0, 10.0)
    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    steps, every = ((1, 2, 5), 1) if last - first <= 3 else ((1,), 1 + (last - first) // 12)
    lines = [step * 10.0**k for k in range(first, last + 1, every) for step in steps]
    axis = alt.Axis(values=lines, labelOverlap=True, format=".0e" if power_of_ten else "~s" if last - first > 5 else "~g")
    if sum(low <= line <= high for line in lines) < 2:  # too short a stretch for these
        axis = alt.Axis(labelOverlap=True, format="~g")
    return {"shorthand": f"{field}:Q", "scale": alt.Scale(type="log", nice=False, padding=8), "title": title, "axis": axis}


def named(table: pd.DataFrame, x: str, y: str, name: str = "solver", wide: int = 980, high: int = 420) -> list[str]:
    """On which side of its point a name has room, "left" near the right end, or ""; those of the front first.

    A name takes 6 by 13 pixels a letter.
    """
    taken: dict[str, list[tuple[float, float, float]]] = {}
    found = pd.Series("", index=table.index)
    at = pd.DataFrame({column: np.log10(table[column].astype(float)) for column in (x, y)})
    for view, part in table.groupby("view", sort=False):
        here = at.loc[part.index]
        scale = np.array([wide, high]) / np.maximum((here.max() - here.min()).to_numpy(), 1e-9)
        places, middle = taken.setdefault(str(view), []), float(here[x].min() + here[x].max()) / 2.0 * scale[0]
        for index in part.sort_values(["front", x], ascending=[False, True]).index:
            (left, top), width = here.loc[index].to_numpy() * scale, 6.0 * len(table[name][index]) + 12.0
            side = "left" if left + width > middle + wide / 2.0 else "right"
            left -= width if side == "left" else 0.0
            if all(left + width < other or left > end or abs(top - level) > 13.0 for other, end, level in places):
                places.append((left, left + width, top))
                found[index] = side
    return found.tolist()


def names_beside(base: alt.Chart, name: str = "solver", least: int = 600) -> list[alt.Chart]:
    """The names of `named` points; a page below ``least`` pixels, where hidden text would still take room, has those of the front only.

    Points without a name have an empty one: were they filtered out, an axis would get the extent of no data at all.
    """
    def text(side: str) -> Any:
        return alt.condition(f"datum.named == '{side}' && (width > {least} || datum.front)", f"{name}:N", alt.value(""))

    return [base.mark_text(align="left", dx=7, dy=-6).encode(text=text("right")),
            base.mark_text(align="right", dx=-7, dy=-6).encode(text=text("left"))]


def lines(table: pd.DataFrame, x: alt.X, y: alt.Y, tips: Sequence[alt.Tooltip], labels: str, log_y: bool,
          step: bool = False, deadline: bool = False) -> list[alt.TopLevelMixin]:
    """One line a solver lane; that under the pointer is strong and named, and those marked ``front`` have names."""
    table = spread_labels(table, labels, log_y).assign(period=PERIOD_US)
    source = data(table)  # one for all layers, or the choice of the view would not reach some
    near = alt.selection_point(fields=["name"], on="pointerover", nearest=True, empty=False, clear="pointerout")
    lane = alt.selection_point(fields=["lane"], bind="legend")
    colour = alt.Color("lane:N", scale=lane_scale(table, LANES))
    dash = alt.StrokeDash("lane:N", scale=lane_scale(table, DASHES))
    base = alt.Chart(source).encode(x=x, y=y)
    drawn = base.mark_line(interpolate="step-after" if step else "linear", strokeWidth=1.6, clip=True).encode(
        color=colour, strokeDash=dash, detail=["name:N"],
        opacity=alt.when(near).then(alt.value(1.0)).when(lane).then(alt.value(0.8)).otherwise(alt.value(0.05)),
        strokeWidth=alt.when(near).then(alt.value(4)).otherwise(alt.value(1.6))).add_params(lane)
    points = base.mark_point(filled=True, size=30, clip=True).encode(
        color=colour, tooltip=list(tips), opacity=alt.when(near).then(alt.value(1)).otherwise(alt.value(0.25))).add_params(near)
    text = alt.Chart(source).transform_filter("datum.label_at != null").mark_text(align="right", dx=-4, dy=-8, baseline="middle")
    words = text.encode(x=alt.value("width"), y=alt.Y("label_at:Q"), text="name:N", color=colour)
    rule = alt.Chart(source).mark_rule(strokeDash=[5, 4]).encode(y="min(period):Q")
    return [finished(alt.layer(drawn, points, *([rule] if deadline else []), words), views(table))]


def spread_labels(table: pd.DataFrame, column: str, log_scale: bool, apart: float = 0.055) -> pd.DataFrame:
    """Add ``label_at``: where the names of the lines marked ``front`` stand at their right ends, not on each other."""
    table = table.reset_index(drop=True).assign(label_at=np.nan)
    if not table.front.any():
        return table
    values = np.log10(table[column].where(table[column] > 0.0)) if log_scale else table[column].astype(float)
    for _, part in table.groupby("view"):
        low, high = float(values[part.index].min()), float(values[part.index].max())
        step = apart * ((high - low) or 1.0)
        last = part[part.front & values[part.index].notna()].groupby("name", sort=False).tail(1).index
        at = high + step
        for index in values[last].sort_values(ascending=False, kind="stable").index:
            at = min(float(values[index]), at - step)
            table.loc[index, "label_at"] = 10.0**at if log_scale else at
    return table
