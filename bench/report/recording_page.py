"""The page of one recording, with measured and modelled loops, error over time, weights and spectrum of the error; and
the page of a drive to record."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.report.fit_review import Review
from bench.report.report import GREY, PALETTE, Axis, Figure, Mark, Plot, Report, Table
from bench.report.writing import write_page
from solvers.arrays import Index, Vector

POINTS, DRIVE_POINTS = 2_500, 8_000
"""Largest number of points of a line; of a drive, which ends with a fast sweep."""
BLUE, RED, GREEN = PALETTE[:3]
STANDING = {"free": BLUE, "at its bound": "#e69f00", "never reached": RED}


def write(path: Path, name: str, review: Review) -> Path:
    """Write the page and ``<page>-figures/*.csv`` beside it; returns its path."""
    return write_page(report(name, review), path, f"{path.stem}-figures")


def report(name: str, review: Review) -> Report:
    """Report of a recording and its model."""
    s = review.model.structure
    input_unit, output_unit = (unit.replace("um", "µm") for unit in (s.input_unit, s.output_unit))
    (first, *more), selection = review.sentences, review.model.report.get("selection")
    return Report(
        [first],
        notes=more,
        title=f"Recording {name}",
        tables=[orders_tried(selection)] if selection and review.fitted else [],
        figures=[
            _loops(review, input_unit, output_unit),
            _error(review, output_unit),
            _weights(review),
            _spectrum(review, output_unit),
        ],
    )


def orders_tried(selection: Mapping[str, Any]) -> Table:
    """The candidates among which the orders were chosen, as text."""
    rows = [
        [
            str(c["n"]),
            str(c["m"]),
            ", ".join(f"{rate:.3g}" for rate in c["creep_rates"]),
            str(c["d"]),
            f"{c['error_percent']:.4f}",
            f"{c['bic']:.1f}",
            c["standing"],
        ]
        for c in selection["table"]
    ]
    headings = ("n", "m", "creep rates, 1/s", "unknowns", "RMS error, % of range", "criterion above the smallest", "")
    return Table("Orders by information criterion", headings, rows, 0, note=selection["sentence"])


def _loops(review: Review, input_unit: str, output_unit: str) -> Figure:
    measured = np.where(np.isnan(review.y), review.y_model, review.y)
    at = review.skipped + _extremes(measured[review.skipped :], POINTS)
    table = pd.concat(
        [
            pd.DataFrame({"sample": at, "x": review.x[at], "y": values[at], "name": what})
            for what, values in (("measured", review.y), ("modelled", review.y_model))
        ],
        ignore_index=True,
    ).dropna()
    marks = (
        Mark("line", "name", where={"name": ["measured"]}, size=3.5, opacity=0.45, along="sample"),
        Mark("line", "name", where={"name": ["modelled"]}, size=0.9, along="sample"),
    )
    return Figure(
        "loops",
        "Loops, measured and modelled",
        "Output against input over the counted samples.",
        table,
        [
            Plot(
                Axis("x", f"input, {input_unit}"),
                Axis("y", f"output, {output_unit}"),
                marks,
                colours={"measured": BLUE, "modelled": RED},
                height=420,
            )
        ],
    )


def _error(review: Review, unit: str) -> Figure:
    e = review.error
    at = _extremes(e, POINTS)
    table = pd.DataFrame(
        {
            "time_s": at * review.model.structure.sample_time,
            "error": e[at],
            "counted": np.where(at >= review.skipped, "counted", "not counted"),
        }
    )
    end = 2.0 * np.abs(e[review.skipped :]).max()  # a transient would flatten the rest
    return Figure(
        "error",
        "Error over time",
        "Measured minus modelled output: the lowest and the highest error in each interval of time. Grey samples at "
        "the start are not counted; the axis ends at twice the largest counted error.",
        table,
        [
            Plot(
                Axis("time_s", "time, s"),
                Axis("error", f"error, {unit}", domain=(max(e.min(), -end), min(e.max(), end))),
                (Mark("line", "counted", size=1.0),),
                colours={"counted": BLUE, "not counted": GREY},
                height=260,
            )
        ],
    )


def _weights(review: Review) -> Figure:
    table = pd.DataFrame({**review.weights, "zero": 0.0})
    names, tips = Axis("weight"), ("weight", "standing", "value", "excitation")
    height = 30 + 18 * len(table)
    return Figure(
        "weights",
        "Weights",
        "In normalised units with w_H0 = 1, with 95 % intervals for these orders. Excitation is the RMS of the "
        "operator's signal: the weight of an operator that hardly moves is hardly determined.",
        table,
        [
            Plot(
                Axis("value", "weight, normalised units"),
                names,
                (Mark("range", "standing", x="low", x2="high", opacity=0.5), Mark("point", "standing", size=70.0)),
                tips,
                STANDING,
                height=height,
            ),
            Plot(
                Axis("excitation", "excitation, RMS in normalised units"),
                names,
                (Mark("bar", x2="zero", colour=GREEN),),
                tips,
                height=height,
            ),
        ],
    )


def _spectrum(review: Review, unit: str) -> Figure:
    f, density = review.spectrum()
    table = pd.DataFrame({"frequency_Hz": f, "density": density})[density > 0.0]
    return Figure(
        "spectrum",
        "Residual spectrum",
        "Amplitude density of the error by Welch's method. A flat spectrum is noise, a rise to the left is something "
        "slow that the model misses, and a peak is a resonance or mains hum.",
        table,
        [
            Plot(
                Axis("frequency_Hz", "frequency, Hz", log=True),
                Axis("density", f"error, {unit} per √Hz", log=True, format=".0e"),
                (Mark("line", colour=BLUE, size=1.2),),
                height=300,
            )
        ],
    )


def write_drive(path: Path, times: Vector, drive: Vector, unit: str, sentences: Sequence[str]) -> Path:
    """Write the page of a drive, and ``<page>-figures/*.csv`` beside it; returns its path.

    Parameters
    ----------
    times, drive : array (N,)
        Seconds, and the drive in ``unit``.
    """
    at = _extremes(drive, DRIVE_POINTS)
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


def _extremes(values: Vector, points: int) -> Index:
    """Positions of the lowest and the highest of each of ``points`` / 2 stretches."""
    chunks = np.array_split(np.arange(values.size), min(values.size, points // 2))
    return np.unique([chunk[extreme(values[chunk])] for chunk in chunks for extreme in (np.argmin, np.argmax)])
