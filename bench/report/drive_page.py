"""The page of a drive: the signal over time, and over its first and fastest parts."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from bench.report.report import PALETTE, Axis, Figure, Mark, Plot, Report
from bench.report.writing import write_page
from solvers.arrays import Vector

POINTS = 4000
"""Intervals of time, of each of which the lowest and the highest sample are drawn."""


def write(path: Path, times: Vector, drive: Vector, unit: str, sentences: Sequence[str]) -> Path:
    """Write the page and ``<page>-figures/*.csv`` beside it; returns its path.

    Parameters
    ----------
    times, drive : array (N,)
        Seconds, and the drive in ``unit``.
    """
    parts = np.array_split(np.arange(drive.size), min(POINTS, drive.size))
    at = np.unique([part[extreme(drive[part])] for part in parts for extreme in (np.argmin, np.argmax)])
    figure = Figure(
        "drive",
        "Drive",
        "The drive over time; where it is faster than the picture resolves, its lowest and highest samples.",
        pd.DataFrame({"time_s": times[at], "drive": drive[at]}),
        [
            Plot(
                Axis("time_s", "time, s"),
                Axis("drive", f"drive, {unit}" if unit else "drive"),
                (Mark("line", colour=PALETTE[0], size=1.0),),
                height=300,
            )
        ],
    )
    return write_page(Report(list(sentences), title="Drive to record", figures=[figure]), path, f"{path.stem}-figures")
