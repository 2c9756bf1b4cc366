"""The option ``--solver`` of verbs that learn or identify with one."""

from typing import Annotated

import typer

from solvers import find


def installed(name: str) -> str:
    """The name of a solver that is known and installed here; any other is refused."""
    try:
        find(name).load()
    except KeyError as error:
        raise typer.BadParameter(str(error.args[0])) from None
    except ImportError as error:
        raise typer.BadParameter(f"{name} is not installed here ({error})") from None
    return name


SolverName = Annotated[str, typer.Option("--solver", callback=installed, help="Any registered solver.")]
