"""Options that several verbs share, or that are known only when the program runs: a verb gets a group of them as one
argument."""

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any

Verb = Callable[..., None]


def grouped(group: str, options: Mapping[str, Any]) -> Callable[[Verb], Verb]:
    """Add options, as annotations by their names, to a verb, which gets their values by name as its argument
    ``group``."""

    def decorate(verb: Verb) -> Verb:
        signature = inspect.signature(verb, eval_str=True)
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in options.items()
        ]
        parameters = [*(parameter for name, parameter in signature.parameters.items() if name != group), *added]

        @functools.wraps(verb)
        def wrapped(**given: Any) -> None:
            values = {name: given.pop(name) for name in options}
            verb(**given, **{group: values})

        wrapped.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return wrapped

    return decorate
