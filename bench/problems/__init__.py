"""Problem sets; the folder is the registry: a file here that defines one ``ProblemSet`` adds it."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

from bench.problems.protocol import ProblemSet, RaceProblem

__all__ = ["ProblemSet", "RaceProblem", "find", "sets"]


def sets() -> dict[str, type[ProblemSet]]:
    """Every problem set by name."""
    found = {}
    for file in pkgutil.iter_modules(__path__):
        for cls in vars(importlib.import_module(f"{__name__}.{file.name}")).values():
            if inspect.isclass(cls) and issubclass(cls, ProblemSet) and not inspect.isabstract(cls):
                found[cls.name] = cls
    return found


def find(name: str) -> type[ProblemSet]:
    """Return the problem set of that name; KeyError says which there are."""
    known = sets()
    if name not in known:
        raise KeyError(f"there is no problem set {name!r}; known are {', '.join(sorted(known))}")
    return known[name]
