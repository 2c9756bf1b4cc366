"""Code that runs in the process of a solver; the parent's side is in `solver_child`.

The process loads one solver in one lane, is pinned to a core, and answers requests. It judges nothing: it returns the
answer with its duals and the raw times.

It ends with the exit status FORBIDDEN when it touches files that it must not: those of the race, and those of other
processes. The data of timed calls are secret until their block begins, and it must not read them in its parent's
memory. The watch begins before the solver's file is imported. An audit hook (PEP 578) cannot be removed, and sees every
file and folder that Python opens, lists, moves or removes; it does not see what compiled code does.
"""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from bench.messages.task import ChildSettings, Outcome, attempt, plain
from bench.processes.child_process import FORBIDDEN, limit_memory
from solvers import Described, Entry, Solver, describe, from_file

_loaded: list[type[Solver]] = []
"""The solver of this process; twice after its first answer."""


def install_audit_hook(folders: Sequence[str]) -> None:
    """Watch from now on."""
    hidden = tuple(os.path.realpath(folder) + os.sep for folder in folders)
    # Bound here, so that a solver that replaces them cannot switch the guard off.
    absolute, is_number, this_process, separator = os.path.realpath, str.isdigit, str(os.getpid()), os.sep
    decoded, say, end, status = os.fsdecode, os.write, os._exit, FORBIDDEN

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" or event.startswith("os."):
            for name in [decoded(one) for one in arguments if isinstance(one, str | bytes | os.PathLike)]:
                path = absolute(name) + separator
                _, root, process, *_ = (*path.split(separator), "", "")
                is_other_process = root == "proc" and is_number(process) and process != this_process
                if path.startswith(hidden) or is_other_process:
                    say(2, f"\nopened {name}\n".encode(errors="replace"))
                    end(status)

    if hidden:
        sys.addaudithook(hook)


def load(entry: Entry, settings: ChildSettings, core: int | None) -> Described:
    """Load and describe the solver of this process; from then on the limits hold and the process is watched."""
    install_audit_hook(settings.hidden)
    try:
        description = describe(entry)
    except Exception as error:  # whatever a library raises while it loads is the reason for its absence
        description = Described(entry.name, entry.lane, "", "", "", False, absent=f"{type(error).__name__}: {error}")
    if not description.absent:
        _loaded.append(entry.load())
        limit_memory(settings.memory_mb)
        if core is not None:  # pinned only now, since loading may use all cores
            os.sched_setaffinity(0, {core})
    return replace(description, ladder=tuple(map(plain, description.ladder)), defaults=plain(description.defaults))


def answer(request: Callable[..., Outcome], arguments: tuple[Any, ...]) -> Outcome:
    """Answer a request, a function of the solver that was loaded, of whether it is the first one of the process, before
    which nothing was compiled, loaded or allocated, and of these arguments; an exception becomes an outcome."""
    cls, *answered = _loaded
    outcome = attempt(lambda: request(cls, not answered, *arguments))
    _loaded[1:] = [cls]
    return outcome


def introduce(path: str) -> Entry | str:
    """The entry of a user's file, which can be described, or a sentence about its fault."""
    try:
        describe(entry := from_file(path))
        return entry
    except ImportError as error:
        return str(error).removeprefix(f"{path}: ")
    except Exception as error:  # a user's code may raise anything
        return f"cannot be loaded, {type(error).__name__}: {error}".replace("\n", " ")
