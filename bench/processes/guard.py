"""What the process of a solver is watched for: what it opens that is not its own, and functions that it replaces.

Both are set up before the solver's file is imported. An audit hook (PEP 578) cannot be taken away, and sees every file
that Python opens and every folder that it lists. What times a solver and carries its answers is compared name by name
with what it was, functions of ours with the code and the defaults that they had.
"""

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import FunctionType, ModuleType
from typing import Any

LOOKS = ("open", "os.listdir", "os.scandir")
HOOKS = ("sys.setprofile", "sys.settrace")
Part = tuple[str, Mapping[str, Any], str, Any, Any, Any]
"""Where something is, its name there, what it is, and the code and the defaults of a function."""
MOST = 3
"""Sentences that are kept."""


def install_audit_hook(folders: Sequence[str], modules: Sequence[ModuleType]) -> Callable[[], tuple[str, ...]]:
    """Watch from now on; returns what says what was seen: sentences, none for a solver that does neither."""
    seen: list[str] = []
    places = tuple(os.path.realpath(folder) + os.sep for folder in folders)
    before = [part for module in modules for part in _parts(module)]
    absolute, number, ours = os.path.realpath, str.isdigit, str(os.getpid())

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if event in LOOKS and arguments and isinstance(arguments[0], str | bytes | os.PathLike):
            name = os.fsdecode(arguments[0])
            path = absolute(name) + os.sep
            _, root, process, *_ = (*path.split(os.sep), "", "")
            if (path.startswith(places) or (root == "proc" and number(process) and process != ours)) and len(
                seen
            ) < MOST:
                seen.append(f"opened {name}")
        elif event in HOOKS and len(seen) < MOST:
            seen.append(f"called {event}")

    if places:
        sys.addaudithook(hook)

    def said() -> tuple[str, ...]:
        for where, names, key, was, code, defaults in before:
            now = names.get(key)
            if (
                now is not was or (code is not None and (now.__code__ is not code or now.__defaults__ is not defaults))
            ) and len(seen) < MOST:
                seen.append(f"replaced {where}.{key}")
        return tuple(seen)

    return said


def _parts(module: ModuleType) -> Iterator[Part]:
    """What a module, and its own classes, hold."""
    for name, value in list(vars(module).items()):
        yield _part(module.__name__, vars(module), name, value)
        if isinstance(value, type) and value.__module__ == module.__name__:
            yield from (
                _part(f"{module.__name__}.{name}", vars(value), key, part)
                for key, part in vars(value).items()
                if isinstance(part, FunctionType)
            )


def _part(where: str, names: Mapping[str, Any], key: str, value: Any) -> Part:
    return (
        where,
        names,
        key,
        value,
        *((value.__code__, value.__defaults__) if isinstance(value, FunctionType) else (None, None)),
    )
