"""Report of a fleet: one table with outliers first, and one page.

Let v be a measure of a recording (the logarithm of its error, or a weight of its model), and med and MAD its median and
median absolute deviation over the fleet. The distance of the measure is

    |v − med v| / max(1.4826 MAD v, LEAST),

in standard deviations if v is normally distributed, and robust against outliers. The distance of a recording is the
larger one of its error and of the median over its weights: single weights that the data hardly determine differ in any
fleet. Source: P. J. Rousseeuw and C. Croux, J. Amer. Statist. Assoc. 88 (1993) 1273 to 1283.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd
from markupsafe import Markup

from bench.fleet.fleet import TABLES, Row
from bench.report import words, writing
from bench.report.report import PALETTE, ROW, Axis, Figure, Mark, Plot, Report, Table
from piezo_model.atomic_file import replacing

LEAST = {"log10 error": 0.02, "weight": 1e-3}
"""Smallest deviation that counts as a difference: 5 % of the error, a thousandth in normalised units."""
DISTANT = 5.0
"""Distance beyond which a recording is an outlier."""
LEAST_PERCENT = 1e-9
"""Smaller errors are replaced by this one."""
FIGURES = {"rms_percent": "RMS error, %", "max_percent": "largest, %", "line_percent": "with a line, %"}
"""Columns of the short table, if the job has them."""
NAMED = 4
"""Most files that a sentence names."""
BINS = 24
BLUE, RED = PALETTE[:2]
SHARES = {"lowest": 0.0, "low": 0.05, "median": 0.5, "high": 0.95, "highest": 1.0}


def table_of(rows: Sequence[Row]) -> pd.DataFrame:
    """Rows with ``distance`` and its measure, ``unlike``: refused recordings first, then by decreasing distance."""
    table = pd.DataFrame(rows).assign(distance=np.nan, unlike="")
    known = table.refused == ""
    if known.any():
        error = table.rms_percent.clip(lower=LEAST_PERCENT).map(math.log10)
        weights = pd.DataFrame(
            {name: _score(table[name], LEAST["weight"]) for name in weights_in(table)}, index=table.index
        )
        scores = pd.DataFrame({"error": _score(error, LEAST["log10 error"]), "weights": weights.median(axis=1)})[
            known
        ].fillna(0.0)
        table.loc[known, "distance"] = scores.max(axis=1)
        table.loc[known, "unlike"] = scores.idxmax(axis=1)
    return table.sort_values("distance", ascending=False, na_position="first", kind="stable", ignore_index=True)


def weights_in(table: pd.DataFrame) -> list[str]:
    """Columns that hold weights."""
    return [name for name in map(str, table) if name.startswith("w") or name == "offset"]


def _score(measure: pd.Series, least: float) -> pd.Series:
    deviation = (measure - measure.median()).abs()
    return deviation / max(1.4826 * deviation.median(), least)


def sentences(table: pd.DataFrame, what: str, others: Sequence[str] = ()) -> list[str]:
    """Number of recordings, of outliers, distribution of the errors, and files that are not of this run."""
    fine = table[table.refused == ""]
    found = [f"{len(fine)} of {len(table)} recordings {what}."]
    if len(fine):
        low, middle, high = fine.rms_percent.quantile([0.05, 0.5, 0.95])
        found.append(
            f"RMS error of the output, as a share of its range: {middle:.2g} % in the median, {low:.2g} % to "
            f"{high:.2g} % in nine of ten. Outliers (> {DISTANT:g} robust SD): "
            f"{int((fine.distance > DISTANT).sum())}."
        )
    if own := int(fine.get("own", pd.Series(dtype=bool)).sum()):
        found.append(f"Judged on the recording that the model was fitted to, which says little about others: {own}.")
    if others:
        named = words.joined([*others[:NAMED], f"{len(others) - NAMED} more"] if len(others) > NAMED else others)
        found.append(f"Not of this run, but in the folder: {named}.")
    return found


def report(
    title: str,
    table: pd.DataFrame,
    what: str,
    links: Mapping[str, str] | None = None,
    others: Sequence[str] = (),
) -> Report:
    """The fleet's report; ``links`` maps each name to its product, "" for none, and ``others`` are files in the folder
    that are not of this run."""
    fine, refused = table[table.refused == ""], table[table.refused != ""]
    errors, links = [name for name in FIGURES if name in fine], links or {}
    kinds = ["file"] if any(links.values()) else []
    rows = [
        [
            row["name"],
            *(words.number(row[name]) for name in errors),
            row["unlike"],
            words.number(row["distance"]),
            *(Markup('<a href="{}">file</a>').format(quote(links[row["name"]])) for _ in kinds),
        ]
        for row in fine.to_dict("records")
    ]
    headings = ("recording", *(FIGURES[name] for name in errors), "most unlike in", "standard deviations", *kinds)
    return Report(
        sentences(table, what, others),
        Table(
            "Those most unlike the others first",
            headings,
            rows,
            1,
            note="Errors of the output as a share of its range.",
        ),
        tables=[
            Table("Refused", ("recording", "why"), refused[["recording", "refused"]].values.tolist(), 2),
            Table("In the folder, but not of this run", ("file",), [[name] for name in others], 1),
        ],
        figures=figures(fine),
        title=title,
    )


def write(out: Path, table: pd.DataFrame, found: Report) -> None:
    """Write ``fleet.csv``, ``fleet.parquet`` and the page ``fleet.html``."""
    for name, put in ((TABLES[0], table.to_csv), (TABLES[1], table.to_parquet)):
        with replacing(out / name) as temporary:
            put(temporary, index=False)
    writing.write_page(found, out / "fleet.html", "fleet-figures")


def figures(fine: pd.DataFrame) -> list[Figure]:
    """Distributions of error and weights."""
    if fine.empty:
        return []
    errors, names = fine.rms_percent.clip(lower=LEAST_PERCENT), weights_in(fine)
    edges = np.logspace(np.log10(errors.min()) - 0.01, np.log10(errors.max()) + 0.01, BINS + 1)
    fit = pd.DataFrame(
        {"from_percent": edges[:-1], "to_percent": edges[1:], "recordings": np.histogram(errors, edges)[0], "zero": 0}
    )
    weights = fine[names].quantile(list(SHARES.values())).set_axis(list(SHARES)).T.rename_axis("weight").reset_index()
    ranges = [
        Mark("range", x=low, x2=high, colour=BLUE, size=width, opacity=0.5)
        for width, low, high in ((1.5, "lowest", "highest"), (7.0, "low", "high"))
    ]
    return [
        Figure(
            "fit",
            "Fit",
            "Recordings by the RMS error of the output, as a share of its range.",
            fit,
            [
                Plot(
                    Axis("from_percent", "RMS error, % of the range", log=True),
                    Axis("recordings", "recordings"),
                    (Mark("bar", x2="to_percent", y2="zero", colour=BLUE),),
                    ("recordings", "from_percent", "to_percent"),
                    height=260,
                )
            ],
        ),
        Figure(
            "weights",
            "Weights",
            "In normalised units with w_H0 = 1. Thin: from the lowest to the highest; thick: nine of ten; point: "
            "median.",
            weights,
            [
                Plot(
                    Axis("median", "weight, normalised units"),
                    Axis("weight"),
                    (*ranges, Mark("point", colour=RED, size=70.0)),
                    ("weight", *SHARES),
                    height=30 + ROW * len(names),
                )
            ],
        ),
    ]
