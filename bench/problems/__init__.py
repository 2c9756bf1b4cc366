"""Problem sets; the folder is the registry: a file here that defines one ``ProblemSet`` adds it."""

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Mapping, Sequence

from bench.problems.protocol import ProblemSet, ProblemSetError, RaceProblem

__all__ = ["ProblemSet", "ProblemSetError", "RaceProblem", "all_sets", "check_options", "find", "make", "sets"]


def all_sets() -> dict[str, type[ProblemSet]]:
    """Every problem set by name."""
    found = {}
    for file in pkgutil.iter_modules(__path__):
        for cls in vars(importlib.import_module(f"{__name__}.{file.name}")).values():
            if inspect.isclass(cls) and issubclass(cls, ProblemSet) and not inspect.isabstract(cls):
                found[cls.name] = cls
    return found


def sets() -> dict[str, type[ProblemSet]]:
    """The problem sets that are made from a seed alone, by name."""
    return {name: cls for name, cls in all_sets().items() if not cls.needs}


def find(name: str) -> type[ProblemSet]:
    """Return the problem set of that name; ProblemSetError says which there are."""
    known = all_sets()
    if name not in known:
        raise ProblemSetError(f"there is no problem set {name!r}; known are {', '.join(sorted(known))}")
    return known[name]


def make(name: str, seed: int = 0, options: Mapping[str, str] | None = None) -> ProblemSet:
    """Make a problem set, with those of the options that are its own.

    Raises
    ------
    ProblemSetError
        There is no such set, or an option that it needs is missing.

    Examples
    --------
    >>> len(make("noise", options={"recording": "stage.csv"}))
    5
    """
    cls = find(name)
    own = {**cls.needs, **cls.takes}
    return cls(seed, **{option: value for option, value in (options or {}).items() if option in own})


def check_options(names: Sequence[str], options: Iterable[str]) -> None:
    """ProblemSetError where none of these sets takes one of the options, or there is no such set."""
    chosen = [find(name) for name in names]
    for option in options:
        if not any(option in (*cls.needs, *cls.takes) for cls in chosen):
            takers = [name for name, cls in sorted(all_sets().items()) if option in (*cls.needs, *cls.takes)]
            raise ProblemSetError(
                f"--{option.replace('_', '-')} is for the problem set {' or '.join(takers)}, and not "
                f"for {' and '.join(names)}"
            )
