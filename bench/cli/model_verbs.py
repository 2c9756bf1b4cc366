"""Verbs for an identified model: ``validate`` it on another recording, ``simulate`` a drive with it."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from bench.cli.fleet import OutDir, only, process
from bench.cli.options import (
    READING,
    STARTS,
    Start,
    files_of,
    grouped,
    on_workers,
    opening,
    reads_a_recording,
    recording_of,
)
from bench.fleet.jobs import Validating
from bench.fleet.storage import absolute
from bench.processes.engine import Workers
from bench.report.console import AsJson, check_writable, print_result
from piezo_model import checks
from piezo_model.deployment import open_model
from piezo_model.model import ModelError
from piezo_model.recordings import read_reference, write_table
from piezo_model.units import quantity


@on_workers
@reads_a_recording
def validate_verb(
    context: typer.Context,
    model: Annotated[
        str, typer.Argument(help="Model from identify; for many recordings also the folder of their models.")
    ],
    reading: dict[str, Any],
    workers: Workers,
    recording: Annotated[
        list[str] | None,
        typer.Argument(help="A recording in any known format; or many, as paths or URLs, with --out-dir."),
    ] = None,
    out_dir: OutDir = None,
    page: Annotated[Path | None, typer.Option(help="HTML file for a page with plots.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check a model against another recording than that of its identification, or against many.

    The initial states are estimated as in identify; a constant shift of the output between the two sessions is removed
    and reported. A sentence says if the model was fitted to the recording itself.
    """
    file = recording_of(recording, reading)
    job = Validating(absolute(model), reading)
    if out_dir is not None or len(recording or ()) > 1:
        process(job, recording or (), out_dir, workers, "Validation of a fleet", "were judged", as_json, page)
        return
    only(context, recording or (), out_dir)
    if page is not None:
        check_writable(page, "--page", [*files_of(file, reading), model])
    opened, loaded, result = job.judged(file, Path(model))
    if page is not None:
        from bench.report import recording_page  # plots take a second to import
        from piezo_model.identification.fit_review import review

        recording_page.write(page, Path(opened.name).name, review(opened, loaded, result))
    lines = [opened.describe(), *result.sentences(), f"Page: {page}" if page else ""]
    print_result({"model": model, "page": page, **result.to_dict()}, lines, as_json)


@grouped(
    "reading",
    {
        "time": READING["time"],
        "column": Annotated[str | None, typer.Option("--input", help="Input column, such as voltage_V.")],
        **READING,
    },
    opening,
)
def simulate_verb(
    model: Annotated[Path, typer.Argument(help="Model from identify.")],
    drive: Annotated[Path, typer.Argument(help="File with a drive column, in any format of recordings.")],
    out: Annotated[Path, typer.Option(help="CSV or Parquet file for drive and output.")],
    reading: dict[str, Any],
    start: Start | None = None,
    as_json: AsJson = False,
) -> None:
    """Compute the output of the model for a drive."""
    check_writable(out, others=[drive, model])
    loaded, _ = open_model(model)
    read = read_reference(drive, role="input", **reading)
    given = read.suited(loaded.structure.input_unit, "input")
    with checks.refusing(ModelError, f"{model} with {drive}: "):
        loaded = loaded.at(read.sample_time)
    s = loaded.structure
    state, began = loaded.initial_state(start), start or ("rest" if loaded.start is None else "recording")
    y = loaded.simulate(given.values, state)
    names = (f"{name}_{unit}" if unit else name for name, unit in (("drive", s.input_unit), ("output", s.output_unit)))
    columns = {"time_s": np.arange(y.size) * given.sample_time, **dict(zip(names, (given.values, y), strict=True))}
    write_table(out, columns, loaded.warning)
    lowest, highest = y.min(), y.max()
    document = {
        "output": out,
        "samples": y.size,
        "lowest": lowest,
        "highest": highest,
        "unit": s.output_unit,
        "start": began,
        "units": given.units,
        "forced": loaded.warning,
    }
    lines = [
        loaded.warning,
        given.units,
        STARTS[began].format(quantity(s.x_centre + s.x_scale * state.play[0], s.input_unit)),
        f"{y.size} samples of output from {quantity(lowest, s.output_unit)} to {quantity(highest, s.output_unit)}.",
        f"Output: {out}",
    ]
    print_result(document, lines, as_json)
