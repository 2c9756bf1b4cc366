"""Watches the process of a solver for files that it must not open and for functions that it replaces.

The watch begins before the solver's file is imported. An audit hook (PEP 578) cannot be removed, and sees every file
that Python opens and every folder that it lists. The modules that time a solver and carry its answers are compared with
their earlier state name by name, our functions also by code and defaults.
"""

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import FunctionType, ModuleType
from typing import Any

FILE_EVENTS = ("open", "os.listdir", "os.scandir")
TRACE_EVENTS = ("sys.setprofile", "sys.settrace")
MOST = 3
"""Largest number of reported actions."""
State = tuple[Any, Any, Any]


def install_audit_hook(folders: Sequence[str], modules: Sequence[ModuleType]) -> Callable[[], tuple[str, ...]]:
    """Watch from now on; returns a function that lists the forbidden actions so far as sentences."""
    actions: list[str] = []
    hidden = tuple(os.path.realpath(folder) + os.sep for folder in folders)
    before = [attribute for module in modules for attribute in _attributes(module)]
    # Bound here, so that a solver that replaces them cannot switch the guard off.
    absolute, is_number, this_process, separator = os.path.realpath, str.isdigit, str(os.getpid()), os.sep
    most, file_events, trace_events, state = MOST, FILE_EVENTS, TRACE_EVENTS, _state

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if len(actions) >= most:
            return
        if event in trace_events:
            actions.append(f"called {event}")
        elif event in file_events and arguments and isinstance(arguments[0], str | bytes | os.PathLike):
            name = os.fsdecode(arguments[0])
            path = absolute(name) + separator
            _, root, process, *_ = (*path.split(separator), "", "")
            is_other_process = root == "proc" and is_number(process) and process != this_process
            if path.startswith(hidden) or is_other_process:
                actions.append(f"opened {name}")

    if hidden:
        sys.addaudithook(hook)

    def forbidden_actions() -> tuple[str, ...]:
        for where, names, name, was in before:
            if any(now is not then for now, then in zip(state(names.get(name)), was, strict=True)):
                actions.append(f"replaced {where}.{name}")
        return tuple(actions[:most])

    return forbidden_actions


def _attributes(module: ModuleType) -> Iterator[tuple[str, Mapping[str, Any], str, State]]:
    """The attributes of a module and the methods of its own classes: owner, its dictionary, name in that, and state."""
    for name, value in list(vars(module).items()):
        yield module.__name__, vars(module), name, _state(value)
        if isinstance(value, type) and value.__module__ == module.__name__:
            for member, function in vars(value).items():
                if isinstance(function, FunctionType):
                    yield f"{module.__name__}.{name}", vars(value), member, _state(function)


def _state(value: Any) -> State:
    """A value, with code and defaults of a function."""
    return value, getattr(value, "__code__", None), getattr(value, "__defaults__", None)
