"""Options that the command line names and a call would not use: they are refused."""

from collections.abc import Iterable

import typer


def is_given(context: typer.Context, option: str) -> bool:
    """Whether the command line names this parameter of the verb, if only with its default."""
    source = context.get_parameter_source(option)
    return source is not None and source.name == "COMMANDLINE"


def refuse(context: typer.Context, options: Iterable[str], why: str) -> None:
    """Refuse these parameters of the verb where the command line names one; ``why`` follows its name."""
    for option in options:
        if is_given(context, option):
            raise typer.BadParameter(
                why, param_hint=next(each.opts[0] for each in context.command.params if each.name == option)
            )
