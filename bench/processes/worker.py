"""What runs in the process of a solver; the parent's side is in `solver_child`.

It loads one solver in one lane, is pinned to a core, and answers requests. It decides nothing about right and wrong: it
hands back the answer with its duals, the raw times and what it noticed about the solver's manners.
"""

import gc
import os
import pickle
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import connection
from typing import TypeVar

import numpy as np

from bench.messages.task import Outcome, Request, attempt
from bench.processes.guard import install_audit_hook
from piezo_model import child_process
from piezo_model.child_process import limit_memory
from solvers.protocol import Solver
from solvers.registry import Described, Entry, describe

E = TypeVar("E", bound=Entry)

_watch: list[Callable[[], tuple[str, ...]]] = []
"""What says how this process behaved."""
_loaded: list[type[Solver]] = []
"""The solver of this process, and once more when it has answered a request."""


@dataclass(frozen=True)
class ChildSettings:
    """What the process of a solver may take and see, and what it imports before its solver."""

    time_limit_s: float = 20.0
    """For each request, everything included."""
    memory_mb: int = 2048
    """What it may allocate once its solver is loaded."""
    hidden: tuple[str, ...] = ()
    """Folders that it must not look into."""
    preload: tuple[str, ...] = ()
    """Modules that its requests need."""


def load(entry: Entry, settings: ChildSettings, core: int | None) -> Described:
    """Load the solver of this process and describe it; its limits hold from then on, and it is watched from now on."""
    for name in settings.preload:
        import_module(name)
    ours = [module for name, module in sys.modules.items() if name.startswith("bench.")]
    _watch.append(install_audit_hook(settings.hidden, [*ours, child_process, connection, gc, np, pickle, time]))
    try:
        description = describe(entry)
    except Exception as error:  # whatever a library does while it loads is a reason for its absence
        description = Described(entry.name, entry.lane, "", "", "", False, absent=f"{type(error).__name__}: {error}")
    if not description.absent:
        _loaded.append(entry.load())
        limit_memory(settings.memory_mb)
        if core is not None:  # after loading, for which all cores are welcome
            os.sched_setaffinity(0, {core})
    return description


def answer(request: Request) -> Outcome:
    """Do what is asked with the solver that was loaded."""
    cls, *answered = _loaded
    outcome = attempt(lambda: request.answer(cls, first=not answered))
    _loaded[1:] = [cls]
    return outcome


def seen() -> tuple[str, ...]:
    """What this process did that it must not, in sentences."""
    return _watch[0]()


def introduce(path: str, of_file: Callable[[str], E]) -> E | str:
    """The entry of a user's file, or a sentence that says what is wrong with it."""
    try:
        return of_file(path)
    except ImportError as error:
        return str(error).removeprefix(f"{path} ")
    except Exception as error:  # whatever a user's code does
        return f"cannot be loaded, {type(error).__name__}: {error}".replace("\n", " ")
