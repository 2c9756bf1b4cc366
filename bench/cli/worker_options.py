"""The options of every verb that spreads its work, defined once."""

from typing import Annotated

import typer

from bench.processes.engine import Backend

SPREADING = ("workers", "backend", "scheduler")
"""The parameters of a verb that has these options."""
WorkerCount = Annotated[
    int, typer.Option("--workers", min=1, help="Processes that work at once, each on a core of its own.")
]
WorkerBackend = Annotated[Backend, typer.Option("--backend", help="Where the workers are.")]
Scheduler = Annotated[
    str, typer.Option("--scheduler", help="Address of a Dask scheduler, whose workers reach the same folder.")
]
