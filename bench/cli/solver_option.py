"""The option ``--solver`` of verbs that learn or identify with one."""

from __future__ import annotations

import typer

from solvers import find


def check_solver(name: str) -> None:
    """Refuse a solver that is not known, or not installed."""
    try:
        find(name).load()
    except KeyError as error:
        raise typer.BadParameter(str(error.args[0]), param_hint="--solver") from None
    except ImportError as error:
        raise typer.BadParameter(f"{name} is not installed here ({error})", param_hint="--solver") from None
