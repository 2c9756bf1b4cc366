"""The folder is the registry: ``solvers/<lane>/<name>.py`` holds the solver <name> in the lane <lane>.

A new file is enough to race a solver; one written for this project is also named in ``OURS``. A module is imported only
when its solver is used, since some libraries cannot share a process; a solver whose library is not installed is
reported as absent with the reason. ``solvers/<lane>_lane.py`` is the file of a whole lane (qpsolvers, cvxpy), with the
function ``make(name)``; the names there are in a table of :mod:`solvers.backend`.

Other packages add solvers by entry points of the group ``piezobench.solvers``. The name of an entry point is lane and
name of the solver (lane direct by default), its value is the class:

    [project.entry-points."piezobench.solvers"]
    "direct.my_solver" = "my_package.my_solver:MySolver"
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.metadata
import importlib.util
import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from solvers import backend
from solvers.core import module_at
from solvers.protocol import Lane, Solver

FAMILIES = {Lane.QPSOLVERS: backend.QPSOLVERS, Lane.CVXPY: backend.CVXPY}
"""Names of solvers in the lanes that have one file for all."""
GROUP = "piezobench.solvers"
OURS = frozenset(
    {
        "accelerated_projection",
        "box_active_set",
        "projected_difference",
        "recursive_active_set",
    }
)
"""Solvers that were written for this project, those of older runs (recursive_active_set) included."""
_added: list[Entry] = []


class RegistrationError(ValueError):
    """A solver is registered under an invalid name or one that is taken; the message is one sentence."""


@dataclass(frozen=True)
class Entry:
    """One solver in one lane, known by its file and not yet imported."""

    name: str
    lane: Lane
    module: str
    path: Path | None = None
    of_package: str = ""
    """Name of the class in the module, for solvers of other packages."""

    @property
    def times_itself(self) -> bool:
        """Whether it is timed inside compiled code, by ``time_kernel``; only the solvers of this package may report
        their own times."""
        return self.lane is Lane.KERNEL and self.path is None and not self.of_package

    def load(self) -> type[Solver]:
        """Import the solver's class; raises ImportError if its library is not installed."""
        if self.of_package:
            return _class_of_package(self)
        if self.path:
            return only_class(import_file(self.path), Solver)
        module = importlib.import_module(self.module)
        return module.make(self.name) if hasattr(module, "make") else only_class(module, Solver)


@dataclass(frozen=True)
class Described:
    """The description of an entry that ``piezobench solvers`` shows."""

    name: str
    lane: Lane
    algorithm: str = ""
    version: str = ""
    licence: str = ""
    warm_start: bool = False
    ladder: tuple[Mapping[str, Any], ...] = ({},)
    """The rungs for a problem whose constant is 1, ``defaults`` included."""
    defaults: Mapping[str, Any] = field(default_factory=dict)
    """Settings that always apply."""
    exponents: tuple[float, ...] = ()
    """Exponents of the rungs, see :class:`solvers.protocol.Solver`."""
    absent: str = ""
    """Why the solver is absent, or empty."""


def import_file(path: Path) -> ModuleType:
    """Import a user's own file; ImportError if it is not a Python file."""
    if not path.is_file():
        raise ImportError(f"{path}: there is no such file")
    return module_at(f"piezobench_user_{path.stem}", path)


def only_class(module: ModuleType, base: type[Any]) -> type[Any]:
    """The one concrete subclass of ``base`` that a module defines; ImportError if it defines none or several, with the
    methods that are missing."""
    defined = [
        cls
        for cls in vars(module).values()
        if inspect.isclass(cls) and issubclass(cls, base) and cls.__module__ == module.__name__
    ]
    whole = [cls for cls in defined if not inspect.isabstract(cls)]
    if len(whole) != 1:
        reason = f"must define one {base.__name__} class, and defines {len(whole)}"
        if defined and not whole:
            missing: frozenset[str] = vars(defined[-1])["__abstractmethods__"]
            reason = f"its class {defined[-1].__name__} lacks {' and '.join(sorted(missing))}"
        raise ImportError(f"{module.__file__}: {reason}")
    return whole[0]


def _class_of_package(entry: Entry) -> type[Solver]:
    cls = vars(importlib.import_module(entry.module)).get(entry.of_package)
    if not (inspect.isclass(cls) and issubclass(cls, Solver)):
        raise ImportError(f"{entry.module} has no Solver class {entry.of_package}")
    if (cls.name, cls.lane) != (entry.name, entry.lane):
        raise ImportError(
            f"{entry.module}:{entry.of_package} calls itself {cls.name} in the lane {cls.lane}, and is registered "
            f"as {entry.name} in the lane {entry.lane}"
        )
    return cls


def entries() -> Iterator[Entry]:
    """Every solver of every lane, those of other packages and files last, without importing their libraries.

    Raises
    ------
    RegistrationError
        Another package registers a solver under an invalid name or one that is taken.
    """
    yield from _entries(tuple(sys.path), Path(__file__).parent)
    yield from _added


@cache
def _entries(path: tuple[str, ...], here: Path) -> tuple[Entry, ...]:
    """The entries in a folder and in the packages on a search path: an identification finds its solver a hundred times,
    and the metadata of all packages take longer to read than its programs to solve."""
    found = {(entry.name, entry.lane): entry for entry in _own_entries(here)}
    for registered in importlib.metadata.entry_points(group=GROUP):
        entry = _registered(registered)
        if (entry.name, entry.lane) in found:
            raise RegistrationError(
                f"{_package(registered)} registers a solver {entry.name} in the lane {entry.lane}, which "
                f"has one already"
            )
        found[entry.name, entry.lane] = entry
    return tuple(found.values())


def _registered(registered: importlib.metadata.EntryPoint) -> Entry:
    lane, _, name = registered.name.partition(".")
    if lane not in set(Lane):
        lane, name = Lane.DIRECT, registered.name
    if not re.fullmatch(r"\w[\w.+-]*", name) or not registered.attr:
        raise RegistrationError(
            f"{_package(registered)} registers a solver as {registered.name!r} = "
            f"{registered.value!r}; the name is lane.name and the value module:Class"
        )
    return Entry(name, Lane(lane), registered.module, of_package=registered.attr)


def _package(registered: importlib.metadata.EntryPoint) -> str:
    return f"the package {registered.dist.name}" if registered.dist else "a package"


def _own_entries(here: Path) -> Iterator[Entry]:
    for lane in Lane:
        if (here / lane).is_dir():
            for file in sorted((here / lane).glob("[a-z]*.py")):
                yield Entry(file.stem, lane, f"solvers.{lane}.{file.stem}")
                # ours can be called from Python as well
                if lane is Lane.KERNEL and file.stem in OURS:
                    yield Entry(file.stem, Lane.DIRECT, f"solvers.{lane}.{file.stem}")
        elif importlib.util.find_spec(lane.value) is not None:
            for name in FAMILIES[lane]:
                yield Entry(name, lane, f"solvers.{lane}_lane")


def from_file(path: str | Path) -> Entry:
    """The entry of a user's own solver file; its class has name and lane."""
    cls = only_class(import_file(path := Path(path).resolve()), Solver)
    return Entry(str(cls.name), Lane(cls.lane), f"piezobench_user_{path.stem}", path)


def add_file(path: str | Path) -> Entry:
    """Register a user's own solver file in this process, so that :func:`find` and :func:`get` know it by its name.

    Raises
    ------
    ImportError
        The file is not a solver.
    RegistrationError
        There is a solver of that name in that lane already.
    """
    entry = from_file(path)
    if entry not in _added:
        if any((known.name, known.lane) == (entry.name, entry.lane) for known in entries()):
            raise RegistrationError(
                f"{path}: there is a solver {entry.name} in the lane {entry.lane} already; name it otherwise"
            )
        _added.append(entry)
    return entry


def find(name: str, lane: Lane | str | None = None) -> Entry:
    """The entry of that name in the given lane, by default in the fastest one (the order of :class:`Lane`), but that of
    a library by its own interface."""
    matches = [entry for entry in entries() if entry.name == name and lane in (None, entry.lane)]
    if matches:
        return min(matches, key=lambda entry: entry.lane is Lane.KERNEL and entry.name not in OURS)
    place = "" if lane is None else f" in the lane {Lane(lane).value!r}"
    raise KeyError(f"there is no solver {name!r}{place}; known are {', '.join(sorted({e.name for e in entries()}))}")


def get(name: str, lane: Lane | str | None = None, **settings: Any) -> Solver:
    """Make a solver by name.

    Examples
    --------
    >>> import numpy as np, qpsolvers, solvers
    >>> s = solvers.get("projected_difference", steps=200)
    >>> s.setup(qpsolvers.Problem(np.eye(2), np.array([-1.0, 1.0]), lb=np.zeros(2), ub=np.full(2, np.inf)))
    >>> s.solve().round(6).tolist()
    [1.0, 0.0]
    """
    return find(name, lane).load()(**settings)


def describe(entry: Entry) -> Described:
    """Import the class of an entry and describe it; if that fails, the description has the reason."""
    try:
        cls = entry.load()
    except ImportError as error:
        return Described(entry.name, entry.lane, absent=str(error))
    try:
        version = importlib.metadata.version(cls.distribution)
    except importlib.metadata.PackageNotFoundError:  # a user's own solver need not belong to an installed package
        if entry.path is None and not entry.of_package:
            reason = f"its class names the distribution {cls.distribution!r}, which is not installed"
            return Described(entry.name, entry.lane, absent=reason)
        version = ""
    if entry.path is not None:  # a user's own file changes without its package
        version = f"{version}+{file_digest(entry.path)}".lstrip("+")
    version = f"{version}, {cls.built_with}" if cls.built_with else version
    return Described(
        entry.name,
        entry.lane,
        cls.algorithm,
        version,
        cls.licence,
        cls.warm_startable,
        tuple({**cls.fixed_settings, **rung} for rung in cls.ladder(1.0)),
        dict(cls.fixed_settings),
        tuple(map(float, cls.exponents)),
    )


def file_digest(path: Path) -> str:
    """What the version of a user's own solver says of its file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:8]


def available() -> list[Entry]:
    """The entries whose library is installed here."""
    return [entry for entry in entries() if not describe(entry).absent]
