"""What a fleet says and shows: one table, outliers first, and one page.

With v a measure of a recording (the logarithm of its error, or a weight of its model), med and MAD the median over the fleet and
the median absolute deviation from it, a measure's distance is

    |v − med v| / max(1.4826 MAD v, LEAST),

which is in standard deviations for the normal law, and which many outliers do not hide. That of a recording is the larger of the error's and of
the median over the weights: single weights that the data hardly determine differ in any fleet. Source: P. J. Rousseeuw and C. Croux,
J. Amer. Statist. Assoc. 88 (1993) 1273 to 1283.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from urllib.parse import quote

import altair as alt
import numpy as np
import pandas as pd
from markupsafe import Markup

from bench.fleet.fleet import Row
from bench.fleet.places import folder_here
from bench.report import charts
from bench.report.page import save
from bench.report.report import Figure, Table
from bench.report.words import number
from piezo_model.atomic_file import replacing

LEAST = {"log10 error": 0.02, "weight": 1e-3}
"""Deviations below which nothing is told apart: of 5 % of the error, and of a thousandth of the unit amplitude."""
DISTANT = 5.0
"""Distance from which on a recording is called an outlier."""
LEAST_PERCENT = 1e-9
"""Errors below this are taken for it."""
FIGURES = {"rms_percent": "RMS error, %", "max_percent": "largest, %", "line_percent": "with a line, %"}
"""Of the short table, where the work has them."""
BINS = 24
SHARES = {"lowest": 0.0, "low": 0.05, "median": 0.5, "high": 0.95, "highest": 1.0}


def table_of(rows: Sequence[Row]) -> pd.DataFrame:
    """Rows with ``distance`` and ``unlike``, the measure it is in: what was refused first, then by distance."""
    table = pd.DataFrame(rows).assign(distance=np.nan, unlike="")
    known = table.refused == ""
    if known.any():
        error = table.rms_percent.clip(lower=LEAST_PERCENT).map(math.log10)
        weights = pd.DataFrame({name: _score(table[name], LEAST["weight"]) for name in weights_in(table)}, index=table.index)
        scores = pd.DataFrame({"error": _score(error, LEAST["log10 error"]), "weights": weights.median(axis=1)})[known].fillna(0.0)
        table.loc[known, "distance"] = scores.max(axis=1)
        table.loc[known, "unlike"] = scores.idxmax(axis=1)
    return table.sort_values("distance", ascending=False, na_position="first", kind="stable", ignore_index=True)


def weights_in(table: pd.DataFrame) -> list[str]:
    """Columns that hold weights."""
    return [name for name in map(str, table) if name.startswith("w") or name == "offset"]


def _score(measure: pd.Series, least: float) -> pd.Series:
    off = (measure - measure.median()).abs()
    return off / max(1.4826 * off.median(), least)


def sentences(table: pd.DataFrame, what: str) -> list[str]:
    """How many there are, how well they fit, and which are refused."""
    fine = table[table.refused == ""]
    said = [f"{len(fine)} of {len(table)} recordings {what}."]
    if len(fine):
        low, middle, high = fine.rms_percent.quantile([0.05, 0.5, 0.95])
        said.append(f"RMS error of the output, as a share of its range: {middle:.2g} % in the median, {low:.2g} % to {high:.2g} % in nine of ten. "
                    f"Unlike the others by more than {DISTANT:g} standard deviations: {int((fine.distance > DISTANT).sum())}.")
    return said


def shown(table: pd.DataFrame) -> Table:
    """The short table of what was not refused."""
    fine = table[table.refused == ""]
    there = [name for name in FIGURES if name in fine]
    rows = [[row["name"], *(number(row[name]) for name in there), row["unlike"], number(row["distance"])] for row in fine.to_dict("records")]
    headings = ("recording", *(FIGURES[name] for name in there), "most unlike in", "standard deviations")
    return Table("Those most unlike the others first", headings, rows, 1, note="Errors of the output as a share of its range.")


def write(out: str, title: str, table: pd.DataFrame, what: str, links: Mapping[str, Mapping[str, str]]) -> None:
    """Write ``fleet.csv``, ``fleet.parquet`` and the page ``fleet.html``; ``links`` has files of each name by what they are, "" for none."""
    short = shown(table)
    kinds = [kind for kind in next(iter(links.values())) if any(each[kind] for each in links.values())]
    rows = [[*row, *(Markup('<a href="{}">{}</a>').format(quote(links[row[0]][kind]), kind) if links[row[0]][kind] else "" for kind in kinds)]
            for row in short.rows]
    grid = Table(short.title, (*short.headings, *kinds), rows, 1, note=short.note)
    refused = table[table.refused != ""]
    grids = [*([Table("Refused", ("recording", "why"), refused[["recording", "refused"]].values.tolist(), 2)] if len(refused) else []), grid]
    with folder_here(out) as folder:
        for name, put in (("fleet.csv", table.to_csv), ("fleet.parquet", table.to_parquet)):
            with replacing(folder / name) as temporary:
                put(temporary, index=False)
        save(folder / "fleet.html", "fleet.html.jinja", figures(table), "fleet-figures", title=title, sentences=sentences(table, what), grids=grids)


def figures(table: pd.DataFrame) -> list[Figure]:
    """How error and weights are distributed."""
    fine = table[table.refused == ""]
    if fine.empty:
        return []
    found = [Figure("fit", "Fit", "Recordings by the RMS error of the output, as a share of its range.", *_fit(fine))]
    if weights_in(fine):
        found.append(Figure("weights", "Weights", "In unit amplitudes with w_H0 = 1. Thin: from the lowest to the highest; thick: nine of ten; "
                            "point: median.", *_weights(fine)))
    return found


def _fit(fine: pd.DataFrame) -> tuple[pd.DataFrame, list[alt.TopLevelMixin]]:
    errors = fine.rms_percent.clip(lower=LEAST_PERCENT)
    low, high = np.log10(errors.min()) - 0.01, np.log10(errors.max()) + 0.01
    edges = np.logspace(low, high, BINS + 1)
    table = pd.DataFrame({"from_percent": edges[:-1], "to_percent": edges[1:], "recordings": np.histogram(errors, edges)[0]})
    x = alt.X(**charts.log("from_percent", "RMS error, % of the range", pd.Series(edges)))
    plot = alt.Chart(charts.data(table)).mark_rect(color=charts.PALETTE[0]).encode(
        x=x, x2="to_percent:Q", y=alt.Y("recordings:Q", title="recordings", axis=alt.Axis(tickMinStep=1)), y2=alt.datum(0),
        tooltip=[alt.Tooltip("recordings:Q"), *(alt.Tooltip(f"{name}:Q", format=".3g") for name in ("from_percent", "to_percent"))])
    return table, [charts.finished(plot, None, 260)]


def _weights(fine: pd.DataFrame) -> tuple[pd.DataFrame, list[alt.TopLevelMixin]]:
    names = weights_in(fine)
    table = fine[names].quantile(list(SHARES.values())).set_axis(list(SHARES)).T.rename_axis("weight").reset_index()
    base = alt.Chart(charts.data(table)).encode(y=alt.Y("weight:N", sort=names, title=None), tooltip=[
        alt.Tooltip("weight:N"), *(alt.Tooltip(f"{share}:Q", format=".4g") for share in SHARES)])
    ranges = [base.mark_rule(strokeWidth=width, color=charts.PALETTE[0], opacity=0.5).encode(
                  x=alt.X(f"{low}:Q", title="weight, unit amplitudes"), x2=f"{high}:Q")
              for width, low, high in ((1.5, "lowest", "highest"), (7, "low", "high"))]
    points = base.mark_point(filled=True, size=70, color=charts.PALETTE[1]).encode(x="median:Q")
    return table, [charts.finished(alt.layer(*ranges, points), None, 30 + charts.ROW * len(names))]
