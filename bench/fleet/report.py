"""Table of a fleet, refused recordings and the largest errors first, and what it says in sentences."""

import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from bench.fleet.fleet import TABLE, Row
from bench.report import words
from piezo_model.atomic_file import replacing

NAMED = 4
"""Most files that a sentence names."""


def table_of(rows: Sequence[Row]) -> pd.DataFrame:
    """Rows, those of refused recordings first, then by decreasing error."""
    by_error = sorted(rows, key=lambda row: -row.get("rms_percent", math.inf))
    return pd.DataFrame(by_error)


def sentences(table: pd.DataFrame, what: str, others: Sequence[str] = ()) -> list[str]:
    """Number of recordings, distribution of the errors, and files that are not of this run."""
    fine = table[table.refused == ""]
    lines = [f"{len(fine)} of {len(table)} recordings {what}."]
    if len(fine):
        low, middle, high = fine.rms_percent.quantile([0.05, 0.5, 0.95])
        lines.append(
            f"RMS error of the output, as a share of its range: {middle:.2g} % in the median, {low:.2g} % to "
            f"{high:.2g} % in nine of ten."
        )
    if own := int(fine.get("own", pd.Series(dtype=bool)).sum()):
        lines.append(f"Judged on the recording that the model was fitted to, which says little about others: {own}.")
    if others:
        named = words.joined([*others[:NAMED], f"{len(others) - NAMED} more"] if len(others) > NAMED else others)
        lines.append(f"Not of this run, but in the folder: {named}.")
    return lines


def write(out: Path, table: pd.DataFrame) -> None:
    """Write ``fleet.csv``."""
    with replacing(out / TABLE) as temporary:
        table.to_csv(temporary, index=False)
