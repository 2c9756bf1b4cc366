"""Verbs of a control engineer: ``identify`` a model from a recording, ``compensate`` a reference with it."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from bench.cli.recording_options import FILE, Input, Output, Reading, Time, reads_a_recording
from bench.report import recording_page
from bench.report.console import AsJson, check_writable, console, print_json, print_table, progress_bar
from piezo_model import Compensator, HysteresisCreepModel, Recording, identify
from piezo_model.identification.fit_review import review
from piezo_model.identification.order_selection import select_order
from piezo_model.recordings import RecordingError, read_reference, write_table
from piezo_model.units import quantity
from solvers import find

FOLLOWED = 1e-3
"""Share of the output's range within which the model follows a reference."""


class LagOption(StrEnum):
    """What to do about a lag of the sensor."""

    estimate = "estimate"
    remove = "remove"
    ignore = "ignore"


@reads_a_recording
def identify_verb(
    recording: Annotated[Path, typer.Argument(help=FILE)],
    out: Annotated[Path, typer.Option(help="Where the model is written, JSON.")],
    reading: Reading,
    time: Time = None,
    input: Input = None,
    output: Output = None,
    n: Annotated[int, typer.Option(min=0, help="Order of hysteresis and creep.")] = 5,
    m: Annotated[int, typer.Option(min=0, help="Order of the superposition on each side.")] = 3,
    creep_rates: Annotated[str | None, typer.Option(help="Comma-separated rates in 1/s, or none; chosen from the "
                                                         "recording by default.")] = None,
    skip: Annotated[int | None, typer.Option(min=0, help="Samples at the start not to count; a transient's by "
                                                        "default.")] = None,
    lag: Annotated[LagOption, typer.Option(help="Whether a lag of the sensor is estimated, removed too, or "
                                                "ignored.")] = LagOption.estimate,
    solver: Annotated[str, typer.Option(help="Any registered solver.")] = "box_active_set",
    force: Annotated[bool, typer.Option("--force", help="Write a model even of data that it does not describe.")] = False,
    select: Annotated[bool, typer.Option("--select-order", help="Choose n and m by cross-validation.")] = False,
    page: Annotated[Path | None, typer.Option(help="Where a page with pictures and advice is written, HTML.")] = None,
    as_json: AsJson = False,
) -> None:
    """Identify a model of hysteresis and creep from a recording.

    It says how well the model fits and what it found out about the recording; --page draws it.
    """
    try:
        find(solver).load()
    except KeyError as error:
        raise typer.BadParameter(str(error.args[0]), param_hint="--solver") from None
    except ImportError as error:
        raise typer.BadParameter(f"{solver} is not installed here ({error})", param_hint="--solver") from None
    check_writable(out)
    opened = Recording.open(recording, time=time, input=input, output=output, **reading)
    if page is not None:
        check_writable(page, "--page")
    if not as_json:
        console.print(opened.describe())
    rates = _rates(creep_rates)
    orders = None
    with progress_bar() as progress:
        progress(f"identifying with n = {n}, m = {m}", 0, 1 + select)
        model = identify(opened, n=n, m=m, creep_rates=rates, skip=skip, lag=lag.value, solver=solver, force=force)
        if select:
            orders = select_order(opened, model, solver, progress=progress)
            n, m = orders.chosen.n, orders.chosen.m
            progress(f"identifying with n = {n}, m = {m}", 1, 2)
            model = identify(opened, n=n, m=m, creep_rates=rates, skip=skip, lag=lag.value, solver=solver, force=force)
    model.save(out)
    if page is not None:
        with progress_bar() as progress:
            progress("writing the page", 0, 1)
            recording_page.write(page, recording.name, review(opened, model), orders)
    if as_json:
        print_json({"model": out, "page": page, "report": dict(model.report),
                    "orders": None if orders is None else [asdict(order) for order in orders.orders],
                    "chosen": None if orders is None else asdict(orders.chosen)})
        return
    if orders is not None:
        print_table(("n", "m", "unknowns", "error on data left out, % of range", "standard error"),
                    [(str(o.n), str(o.m), str(o.d), f"{o.error_percent:.4f}", f"{o.standard_error:.4f}")
                     for o in orders.orders], left=0)
        console.print(orders.sentence)
    for sentence in (model.report["headline"], *model.report["findings"], *model.report["advice"]):
        console.print(sentence)
    console.print(f"Model: {out}")
    if page is not None:
        console.print(f"Page: {page}")


@reads_a_recording
def compensate_verb(
    model: Annotated[Path, typer.Argument(help="Model written by identify.")],
    reference: Annotated[Path, typer.Argument(help="A file with a reference column, in any format of recordings.")],
    out: Annotated[Path, typer.Option(help="Where the drive is written, CSV or Parquet.")],
    reading: Reading,
    time: Time = None,
    column: Annotated[str | None, typer.Option("--reference", help="Reference column.")] = None,
    low: Annotated[float | None, typer.Option(help="Lowest drive; the model's range by default.")] = None,
    high: Annotated[float | None, typer.Option(help="Highest drive; the model's range by default.")] = None,
    rate_limit: Annotated[float | None, typer.Option(help="Fastest change of the drive, per second.")] = None,
    as_json: AsJson = False,
) -> None:
    """Compute the drive that makes the actuator follow a reference."""
    check_writable(out)
    loaded = HysteresisCreepModel.load(model)
    s = loaded.structure
    wanted = read_reference(reference, time=time, column=column, **reading)
    if abs(wanted.sample_time / s.sample_time - 1.0) > 0.01:
        raise RecordingError(f"{reference}: is sampled every {wanted.sample_time:g} s and the model every "
                             f"{s.sample_time:g} s")
    if wanted.unit and s.output_unit and wanted.unit != s.output_unit:
        raise RecordingError(f"{reference}: is in {wanted.unit} and the model's output in {s.output_unit}")
    limits = (s.x_centre - s.x_scale if low is None else low, s.x_centre + s.x_scale if high is None else high)
    if not limits[0] < limits[1]:
        raise typer.BadParameter(f"the lowest drive {limits[0]:g} must be below the highest {limits[1]:g}",
                                 param_hint="--low/--high")
    if rate_limit is not None and not rate_limit > 0.0:
        raise typer.BadParameter(f"the fastest change must be positive, not {rate_limit:g}", param_hint="--rate-limit")
    compensator = Compensator(loaded, x_limits=limits, rate_limit=rate_limit)
    x = compensator.run(wanted.values)
    error = loaded.simulate(x) - wanted.values
    followed = float(np.mean(np.abs(error) <= FOLLOWED * 2.0 * abs(s.y_scale)))
    unit = f"_{s.input_unit}" if s.input_unit else ""
    write_table(out, {"time_s": np.arange(x.size) * wanted.sample_time, f"drive{unit}": x})
    saturated = float(np.mean((x <= limits[0]) | (x >= limits[1])))
    if as_json:
        print_json({"drive": out, "samples": x.size, "lowest": x.min(), "highest": x.max(), "unit": s.input_unit,
                    "share_at_limits": saturated, "share_followed": followed, "largest_error": np.max(np.abs(error)),
                    "output_unit": s.output_unit})
        return
    console.print(f"The model follows {100.0 * followed:.3g} % of the reference, to {100.0 * FOLLOWED:g} % of its range; elsewhere it misses "
                  f"by up to {quantity(np.max(np.abs(error)), s.output_unit, 3)}." if followed < 1.0 else
                  f"The model follows all of the reference, to {100.0 * FOLLOWED:g} % of its range.")
    console.print(f"{x.size} samples of drive from {quantity(x.min(), s.input_unit)} to {quantity(x.max(), s.input_unit)}; "
                  + (f"{100 * saturated:.1f} % of them at the limits, where the reference cannot be followed."
                     if saturated else "the limits are never reached."))
    console.print(f"Drive: {out}")


def _rates(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    if text.strip().lower() in ("", "none"):
        return ()
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a list of numbers separated by commas",
                                 param_hint="--creep-rates") from None
