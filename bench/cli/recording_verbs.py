"""Verbs for recordings: ``excite`` writes a drive to record, from which everything in a model can be determined;
``inspect`` shows how a recording is read, before it is used."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from bench.cli.options import AsJson, check_option, check_writable, positive, reads_a_recording, recording_of
from bench.report.console import print_result
from piezo_model import checks, signals
from piezo_model.recordings import Recording, RecordingError, opening, write_table
from piezo_model.recordings.options import ReadOptions
from piezo_model.recordings.table import Table
from piezo_model.units import quantity, shown

MOST_SAMPLES = 100_000_000
"""Samples of the longest drive that is written."""


def excite_verb(
    span: Annotated[str, typer.Option("--range", metavar="LOW:HIGH", help="Lowest and highest drive, such as 0:100.")],
    rate: Annotated[float, typer.Option(metavar="HZ", callback=positive, help="Samples per second.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="CSV or Parquet file for the drive.")],
    seconds: Annotated[float, typer.Option(metavar="SECONDS", callback=positive, help="Duration in s.")] = 60.0,
    unit: Annotated[str, typer.Option(metavar="UNIT", help="Unit of the drive, for the name of its column.")] = "V",
    page: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="HTML file for a picture of the drive.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a drive for a recording that determines hysteresis, creep, a drift of the sensor and dynamics."""
    check_writable(out)
    check_writable(page, "--page", [out])
    low, high = _limits(span)
    check_option(
        rate * seconds <= MOST_SAMPLES,
        "--rate, --seconds",
        f"{rate * seconds:.3g} samples exceed the limit of {MOST_SAMPLES:.0e}",
    )
    try:
        drive = signals.excitation(duration_s=seconds, sample_time=1.0 / rate, low=low, high=high)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--rate, --seconds") from None
    times = np.arange(drive.size) / rate
    write_table(out, {"time_s": times, f"drive_{unit}".rstrip("_"): drive})
    fastest = float(np.abs(np.diff(drive)).max()) * rate
    lines = [
        f"{drive.size} samples over {quantity(seconds, 's')}: decaying triangles at three speeds for hysteresis, two "
        f"holds of {quantity(seconds / 6.0, 's', 3)} for creep, rests at {quantity(low, unit)} for a drift of the "
        f"sensor, and a sine swept up to {quantity(rate / signals.SWEPT, 'Hz', 3)} for dynamics.",
        f"Its steepest slope is {quantity(fastest, f'{unit}/s', 3)}; a slower amplifier changes the drive.",
        f"Drive: {out}",
        f"Page: {page}" if page else "",
    ]
    if page is not None:
        from bench.report import recording_page  # plots take a second to import

        recording_page.write_drive(page, times, drive, unit, lines[:2])
    print_result({"drive": out, "page": page, "samples": drive.size, "steepest_per_s": fastest}, as_json, *lines)


def _limits(text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(":"))
        checks.ascending(range=(low, high))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not two numbers in ascending order, such as 0:100", param_hint="--range"
        ) from None
    return low, high


@reads_a_recording
def inspect_verb(
    reading: dict[str, Any],
    recording: Annotated[Path | None, typer.Argument(help="A recording in any known format.")] = None,
    as_json: AsJson = False,
) -> None:
    """Show how a recording is read: columns, units, sampling and ranges, and which columns are guessed."""
    recording = recording_of([recording] if recording else [], reading)
    options = ReadOptions(**{name: value for name, value in reading.items() if name not in ("time", "input", "output")})
    table = (
        opening.joined(reading["input"], reading["output"], reading.get("time"), options)[0]
        if recording is None
        else opening.open_table(recording, {role: reading.get(role) for role in ("time", "input", "output")}, options)
    )
    refused, opened = None, None
    try:
        opened = Recording.open(recording, **reading)
    except RecordingError as error:
        refused = error
    columns = _columns(table, opened)
    print_result(
        {
            "file": table.path,
            "form": table.form,
            "columns": columns,
            "refused": refused and str(refused),
            **(
                {}
                if opened is None
                else {
                    "sample_time_s": opened.sample_time,
                    "samples": opened.length,
                    "input": opened.columns["input"],
                    "output": opened.columns["output"],
                    "time": opened.columns.get("time"),
                    "guessed": {**opened.reasons, **({"time_unit": "seconds"} if opened.guessed_seconds else {})},
                    "remarks": opened.remarks,
                }
            ),
        },
        as_json,
        opened.describe() if opened else f"{table.path}: {table.form}",
        (
            ("column", "name", "unit", "from", "to", "role"),
            [
                (
                    str(c["number"]),
                    c["name"],
                    shown(c["unit"]),
                    *([quantity(end, "") for end in c["range"]] if c["range"] else ["", ""]),
                    c["role"],
                )
                for c in columns
            ],
            2,
        ),
    )
    if refused:
        raise refused


def _columns(table: Table, opened: Recording | None) -> list[dict[str, Any]]:
    """All columns with their ranges; once the roles are settled, only the ranges of those columns are known."""
    roles, ranges = dict[str, str](), dict[int, tuple[float, float]]()
    if opened is not None:
        roles = {name: role for role, name in opened.columns.items()}
        spans = {"input": opened.x_range, "output": opened.y_range}
        ranges = {k: spans[roles[name]] for k, name in enumerate(table.names) if roles.get(name) in spans}
    else:
        numbers = [
            k
            for k, column in enumerate(table.columns)
            if column.kind == "number" and column.rows == table.columns[0].rows
        ]
        with suppress(RecordingError):  # reported at the end
            heads = table.heads(numbers)
            ranges = {k: (float(head.min()), float(head.max())) for k, head in heads.items() if head.size}
    return [
        {
            "number": k + 1,
            "name": table.names[k],
            "unit": column.unit,
            "kind": column.kind,
            "range": ranges.get(k),
            "role": roles.get(table.names[k], "" if column.kind == "number" else column.kind),
        }
        for k, column in enumerate(table.columns)
    ]
