"""The verb ``excite``: a drive to record, from which everything in a model can be determined."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from bench.cli.options import positive
from bench.report.console import AsJson, check_writable, print_result
from piezo_model import checks
from piezo_model.recordings import write_table
from piezo_model.signals import SWEPT, excitation
from piezo_model.units import quantity


def excite_verb(
    span: Annotated[str, typer.Option("--range", help="Lowest and highest drive, such as 0:100.")],
    rate: Annotated[float, typer.Option(callback=positive, help="Samples per second.")],
    out: Annotated[Path, typer.Option(help="CSV or Parquet file for the drive.")],
    seconds: Annotated[float, typer.Option(callback=positive, help="Duration in s.")] = 60.0,
    unit: Annotated[str, typer.Option(help="Unit of the drive, for the name of its column.")] = "V",
    page: Annotated[Path | None, typer.Option(help="HTML file for a picture of the drive.")] = None,
    as_json: AsJson = False,
) -> None:
    """Write a drive to record: a model identified from it has hysteresis, creep, drift and dynamics determined."""
    check_writable(out)
    if page is not None:
        check_writable(page, "--page", [out])
    low, high = _range(span)
    try:
        drive = excitation(duration_s=seconds, sample_time=1.0 / rate, low=low, high=high)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--rate, --seconds") from None
    times = np.arange(drive.size) / rate
    write_table(out, {"time_s": times, f"drive_{unit}".rstrip("_"): drive})
    fastest = float(np.abs(np.diff(drive)).max()) * rate
    lines = [
        f"{drive.size} samples over {quantity(seconds, 's')}: decaying triangles at three speeds for hysteresis, two "
        f"holds of {quantity(seconds / 6.0, 's', 3)} for creep, rests at {quantity(low, unit)} for a drift of the "
        f"sensor, and a sine swept up to {quantity(rate / SWEPT, 'Hz', 3)} for dynamics.",
        f"Its steepest step is {quantity(fastest, f'{unit}/s', 3)}; an amplifier that is slower records another drive.",
        f"Drive: {out}",
        f"Page: {page}" if page else "",
    ]
    if page is not None:
        from bench.report.drive_page import write  # plots take a second to import

        write(page, times, drive, unit, lines[:2])
    print_result({"drive": out, "page": page, "samples": drive.size, "steepest_per_s": fastest}, lines, as_json)


def _range(text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(":"))
        checks.ascending(range=(low, high))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not two numbers in ascending order, such as 0:100", param_hint="--range"
        ) from None
    return low, high
