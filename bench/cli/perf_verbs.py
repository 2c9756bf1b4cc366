"""The verb ``perf``: the hot kernels beside vectorised NumPy, and a bank of compensators in real time."""

from __future__ import annotations

from typing import Annotated

import typer

from bench import perf
from bench.cli.given_options import refuse


def perf_verb(
    context: typer.Context,
    bank: Annotated[int | None, typer.Option(min=1, help="Step a bank of so many actuators in real time instead.")] = None,
    rate: Annotated[float, typer.Option(min=1.0, max=1e6, help="Of the bank: steps a second.")] = 2000.0,
    seconds: Annotated[float, typer.Option(min=0.01, help="Of the bank: how long; a null step runs as long afterwards.")] = 20.0,
    threads: Annotated[int, typer.Option(min=1, help="Of the bank.")] = 1,
    optima: Annotated[float, typer.Option(min=0.01, help="Of the bank: exact optima a second of each actuator.")] = 10.0,
) -> None:
    """Time the hot kernels on this machine, beside NumPy, or the steps of a bank of compensators.

    PIEZOBENCH_ISA=v3 in the environment asks for AVX2 on a machine that has AVX-512.
    """
    if bank is None:
        refuse(context, ("rate", "seconds", "threads", "optima"), "is for a --bank")
        perf.show()
    else:
        perf.show_bank(bank, rate, seconds, threads, optima)
