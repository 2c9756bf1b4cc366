"""Plots as Vega-Lite specifications, drawn by the page's script or converted to SVG.

Vega's JavaScript of 0.9 MB comes with the package vl-convert-python and works offline (plotly's has 4.6 MB). A
specification is a short JSON text without code, and its SVG takes the page's colours, light or dark.
"""

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from typing import Any

import pandas as pd
import vl_convert

from bench.messages import user_cache
from bench.report.console import plain_json
from bench.report.report import BEST, INK, PALETTE, Axis, Mark, Plot, first_view

VEGA_LITE = "6.4"
WIDTH = 780
"""Width of an SVG in pixels."""
SVG_INK = "#222222"
SOUGHT = "sought != '' && indexof(lower(datum.name), lower(sought)) >= 0"
"""Vega's expression for the rows whose name contains what the reader types."""
CONFIG: dict[str, Any] = {
    "background": "transparent",
    "font": "system-ui, sans-serif",
    "view": {"stroke": None},
    "axis": {
        "labelColor": INK,
        "titleColor": INK,
        "domainColor": INK,
        "tickColor": INK,
        "gridColor": INK,
        "gridOpacity": 0.12,
        "titleFontWeight": "normal",
        "labelFontSize": 11,
        "titleFontSize": 12,
        "labelLimit": 240,
    },
    "legend": {
        "labelColor": INK,
        "titleColor": INK,
        "orient": "top",
        "title": None,
        "labelFontSize": 12,
        "symbolSize": 80,
        "columns": 3,
        "labelLimit": 200,
        "symbolOpacity": 1,
    },
    "title": {"color": INK},
    "rule": {"color": INK},
}
CHANNELS = ("color", "shape", "strokeDash")
KINDS: dict[str, dict[str, Any]] = {
    "line": {"type": "line"},
    "step": {"type": "line", "interpolate": "step-after"},
    "point": {"type": "point", "filled": True},
    "hollow": {"type": "point", "filled": False, "strokeWidth": 1},
    "bar": {"type": "bar"},
    "range": {"type": "rule", "strokeCap": "round"},
    "text": {"type": "text", "fontSize": 12, "dx": {"expr": "datum.dx"}, "dy": {"expr": "datum.dy"}},
}


def library() -> str:
    """Vega's JavaScript, in a form that cannot end a script element.

    It is cached, because bundling it takes longer than writing a page.
    """
    cached = user_cache.folder("vega") / f"{VEGA_LITE}-{version('vl-convert-python')}.js"
    with suppress(OSError):
        return cached.read_text(encoding="utf-8")
    bundle: str = vl_convert.javascript_bundle(vl_version=VEGA_LITE)  # type: ignore[call-arg]
    bundle = bundle.replace("</script", "<\\/script")
    user_cache.keep(cached, bundle)
    return bundle


def specification(table: pd.DataFrame, plot: Plot) -> dict[str, Any]:
    """Specification of a plot that fills the width of the page."""
    shown = table[table[[*plot.where]].isin(dict(plot.where)).all(axis=1)] if plot.where else table
    views = list(dict.fromkeys(map(str, shown["view"]))) if "view" in shown else []
    select = {"input": "select", "options": views, "name": "Show "}
    search = {"input": "search", "name": "Find a line ", "placeholder": "name"}
    params = [
        *([{"name": "view", "value": first_view(shown), "bind": select}] if len(views) > 1 else []),
        *([{"name": "sought", "value": "", "bind": search}] if any(mark.sought for mark in plot.marks) else []),
    ]
    # Vega merges the legends of colour, dash and shape only within one mark; names in the plot replace them
    first = None if any(mark.kind == "text" for mark in plot.marks) else next((m for m in plot.marks if m.by), None)
    rules = [
        {"mark": {"type": "rule", "strokeDash": [5, 4]}, "data": {"values": [{}]}, "encoding": {axis: {"datum": value}}}
        for axis, value in plot.rules.items()
    ]
    return {
        "data": {"values": plain_json(shown.to_dict("records"))},
        "params": params,
        "width": "container",
        "height": plot.height,
        "config": CONFIG,
        "transform": [{"filter": "datum.view == view"}] if len(views) > 1 else [],
        "layer": [*rules, *(_layer(shown, plot, mark, mark is first) for mark in plot.marks)],
        "resolve": {"scale": dict.fromkeys(CHANNELS, "independent")},
    }


def _layer(table: pd.DataFrame, plot: Plot, mark: Mark, legend: bool) -> dict[str, Any]:
    """One mark of a plot. The rows of a coloured mark are filtered, and so its legend; any other mark is hidden by its
    opacity, because axes without rows have no extent."""
    columns = [{"field": column, "oneOf": [*values]} for column, values in mark.where.items()]
    selected: Any = SOUGHT if mark.sought else {"and": columns} if columns else None
    filtered = selected if mark.by and not plot.colours else None
    is_line, is_point = mark.kind in ("line", "step"), mark.kind in ("point", "hollow")
    size = {"size": mark.size} if is_point else {} if mark.kind == "bar" else {"strokeWidth": mark.size}
    encoding: dict[str, Any] = {
        "x": _position(table, plot.x, mark.x),
        "y": _position(table, plot.y),
    }
    optional: dict[str, Any] = {
        "x2": mark.x2 and {"field": mark.x2},
        **_coloured(plot, mark, is_line, is_point, legend),
        "text": mark.kind == "text" and {"field": "name"},
        "detail": is_line and "name" in table and {"field": "name", "type": "nominal"},
        "order": mark.along and {"field": mark.along, "type": "quantitative"},
        "tooltip": not is_line
        and [
            {"field": name, "format": ".4~g", "type": "quantitative"} if _is_number(table, name) else {"field": name}
            for name in plot.tips
        ],
    }
    encoding |= {channel: definition for channel, definition in optional.items() if definition}
    test, opacity = None if filtered else selected, {"value": mark.opacity}
    encoding["opacity"] = {"condition": {"test": test, **opacity}, "value": 0} if test else opacity
    colour = {} if mark.by or not mark.colour else {"color": mark.colour}
    return {
        "transform": [{"filter": filtered}] if filtered else [],
        "mark": {**KINDS[mark.kind], "clip": not is_point and mark.kind != "text", **size, **colour},
        "encoding": encoding,
    }


def _is_number(table: pd.DataFrame, column: str) -> bool:
    return (
        column in table
        and bool(pd.api.types.is_numeric_dtype(table[column]))
        and not pd.api.types.is_bool_dtype(table[column])
    )


def _coloured(plot: Plot, mark: Mark, is_line: bool, is_point: bool, legend: bool) -> dict[str, Any]:
    """Colours of a column's values: those given, or the palette twice, the second time with dashes or triangles."""
    if not mark.by:
        return {}
    common = {"field": mark.by, "type": "nominal", **({} if legend else {"legend": None})}
    if plot.colours:
        return {"color": {**common, "scale": {"domain": [*plot.colours], "range": [*plot.colours.values()]}}}
    half = BEST - len(PALETTE)
    ranges: dict[str, Any] = {
        "color": [*PALETTE, *PALETTE[:half]],
        "strokeDash": is_line and [[1, 0]] * len(PALETTE) + [[5, 3]] * half,
        "shape": is_point and ["circle"] * len(PALETTE) + ["triangle-up"] * half,
    }
    return {
        channel: {**common, "sort": None, "scale": {"range": values}} for channel, values in ranges.items() if values
    }


def _position(table: pd.DataFrame, axis: Axis, column: str = "") -> dict[str, Any]:
    """Encoding of an axis and the column along it."""
    field = column or axis.column
    if not _is_number(table, field):
        return {"field": field, "type": "nominal", "sort": None, "title": axis.title or None}
    drawn: dict[str, Any] = {
        "labelOverlap": True,
        **({"values": [*axis.values]} if axis.values else {}),
        **({"format": axis.format or "~g"} if axis.format or axis.log else {}),
    }
    scale: dict[str, Any] = {
        "nice": False,
        **({"type": "log", "padding": 8} if axis.log else {"zero": False}),
        **({"domain": [*axis.domain]} if axis.domain else {}),
    }
    return {
        "field": field,
        "type": "quantitative",
        "title": axis.title,
        "axis": drawn,
        "scale": scale,
    }


def svg(table: pd.DataFrame, plots: Sequence[Plot]) -> str:
    """The plots one below the other in dark ink on white, in the default view."""
    drawings = [specification(table, plot) for plot in plots]
    # parameters and configuration belong to the complete drawing, and no parameter is bound to a control
    params = {
        param["name"]: {"name": param["name"], "value": param["value"]}
        for drawing in drawings
        for param in drawing["params"]
    }
    config = {**CONFIG, "background": "white", "aria": False, "font": "sans-serif"}
    whole = {
        "vconcat": [
            {**{key: value for key, value in drawing.items() if key not in ("params", "config")}, "width": WIDTH}
            for drawing in drawings
        ],
        "title": first_view(table),
        "params": [*params.values()],
        "config": config,
        "resolve": {"scale": {"color": "independent", "shape": "independent", "strokeDash": "independent"}},
    }
    drawn: str = vl_convert.vegalite_to_svg(
        json.dumps(whole).replace(INK, SVG_INK), vl_version=VEGA_LITE, allowed_base_urls=[]
    )
    # Vega numbers its clip paths across all plots of a process; renumbering makes equal plots equal files
    numbers: dict[str, int] = {}
    return re.sub(
        r'(id="|url\(#)clip(\d+)', lambda match: f"{match[1]}clip{numbers.setdefault(match[2], len(numbers))}", drawn
    )
