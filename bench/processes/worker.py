"""Code that runs in the process of a solver; the parent's side is in `solver_child`.

The process loads one solver in one lane, is pinned to a core, and answers requests. It judges nothing: it returns the
answer with its duals, the raw times, and what the solver did that it must not.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TypeVar

from bench.messages.task import Outcome, Request, attempt
from bench.processes.guard import install_audit_hook
from piezo_model.child_process import limit_memory
from solvers.protocol import Solver
from solvers.registry import Described, Entry, describe

E = TypeVar("E", bound=Entry)

_guards: list[Callable[[], tuple[str, ...]]] = []
"""Lists the forbidden actions in this process."""
_loaded: list[type[Solver]] = []
"""The solver of this process; twice after its first answer."""


@dataclass(frozen=True)
class ChildSettings:
    """Limits of a solver's process, and the modules that it imports before its solver."""

    time_limit_s: float = 20.0
    """Time limit of each request, everything included."""
    memory_mb: int = 2048
    """Memory that it may allocate once its solver is loaded."""
    hidden: tuple[str, ...] = ()
    """Folders whose files it must not open."""
    preload: tuple[str, ...] = ()
    """Modules that its requests need."""


def load(entry: Entry, settings: ChildSettings, core: int | None) -> Described:
    """Load and describe the solver of this process; from then on the limits hold and the process is watched."""
    for name in settings.preload:
        import_module(name)
    _guards.append(install_audit_hook(settings.hidden))
    try:
        description = describe(entry)
    except Exception as error:  # whatever a library raises while it loads is the reason for its absence
        description = Described(entry.name, entry.lane, "", "", "", False, absent=f"{type(error).__name__}: {error}")
    if not description.absent:
        _loaded.append(entry.load())
        limit_memory(settings.memory_mb)
        if core is not None:  # pinned only now, since loading may use all cores
            os.sched_setaffinity(0, {core})
    return description


def answer(request: Request) -> Outcome:
    """Answer a request with the solver that was loaded."""
    cls, *answered = _loaded
    outcome = attempt(lambda: request.answer(cls, first=not answered))
    _loaded[1:] = [cls]
    return outcome


def forbidden_actions() -> tuple[str, ...]:
    """The forbidden actions in this process so far, as sentences."""
    return _guards[0]()


def introduce(path: str, of_file: Callable[[str], E]) -> E | str:
    """The entry of a user's file, or a sentence about its fault."""
    try:
        return of_file(path)
    except ImportError as error:
        return str(error).removeprefix(f"{path} ")
    except Exception as error:  # a user's code may raise anything
        return f"cannot be loaded, {type(error).__name__}: {error}".replace("\n", " ")
