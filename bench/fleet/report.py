"""Table of a fleet, outliers first, and what it says in sentences.

Let v be a measure of a recording (the logarithm of its error, or a weight of its model), and med and MAD its median and
median absolute deviation over the fleet. The distance of the measure is

    |v − med v| / max(1.4826 MAD v, LEAST),

in standard deviations if v is normally distributed, and robust against outliers. The distance of a recording is the
larger one of its error and of the median over its weights: single weights that the data hardly determine differ in any
fleet. Source: P. J. Rousseeuw and C. Croux, J. Amer. Statist. Assoc. 88 (1993) 1273 to 1283.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from bench.fleet.fleet import TABLE, Row
from bench.report import words
from piezo_model.atomic_file import replacing

LEAST = {"log10 error": 0.02, "weight": 1e-3}
"""Smallest deviation that counts as a difference: 5 % of the error, a thousandth in normalised units."""
DISTANT = 5.0
"""Distance beyond which a recording is an outlier."""
LEAST_PERCENT = 1e-9
"""Smaller errors are replaced by this one."""
NAMED = 4
"""Most files that a sentence names."""


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


def write(out: Path, table: pd.DataFrame) -> None:
    """Write ``fleet.csv``."""
    with replacing(out / TABLE) as temporary:
        table.to_csv(temporary, index=False)
