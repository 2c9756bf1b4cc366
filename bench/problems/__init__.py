"""Problem sets; the folder is the registry: every ``ProblemSet`` class with a name in a file here is one."""

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Mapping, Sequence

from bench.problems.protocol import ProblemSet, ProblemSetError, RaceProblem
from piezo_model.checks import check

__all__ = ["ProblemSet", "ProblemSetError", "RaceProblem", "all_sets", "check_options", "find", "make"]


def all_sets() -> dict[str, type[ProblemSet]]:
    """Every problem set by name."""
    modules = [importlib.import_module(f"{__name__}.{file.name}") for file in pkgutil.iter_modules(__path__)]
    classes = {cls for module in modules for cls in vars(module).values() if inspect.isclass(cls)}
    known = {cls.name: cls for cls in classes if issubclass(cls, ProblemSet) and hasattr(cls, "name")}
    return dict(sorted(known.items()))


def find(name: str) -> type[ProblemSet]:
    """The problem set of that name; ProblemSetError lists the known ones."""
    known = all_sets()
    check(name in known, f"there is no problem set {name!r}; known are {', '.join(known)}", ProblemSetError)
    return known[name]


def make(name: str, seed: int = 0, options: Mapping[str, str] | None = None) -> ProblemSet:
    """Make a problem set from a seed and the options that apply to it.

    Raises
    ------
    ProblemSetError
        There is no such set, or a required option is missing.

    Examples
    --------
    >>> make("noise", options={"recording": "stage.csv"}).names()[:2]
    ['noise-none', 'noise-1e-05']
    """
    cls = find(name)
    return cls(
        seed,
        **{option: value for option, value in (options or {}).items() if option in (*cls.needs, *cls.takes)},
    )


def check_options(names: Sequence[str], options: Iterable[str]) -> None:
    """ProblemSetError for an unknown set, or an option that none of the sets has."""
    list(map(find, names))
    for option in options:
        takers = {name: cls for name, cls in all_sets().items() if option in (*cls.needs, *cls.takes)}
        check(
            not takers.keys().isdisjoint(names),
            f"--{option.replace('_', '-')} is for the problem set {' or '.join(takers)}, and not "
            f"for {' and '.join(names)}",
            ProblemSetError,
        )
