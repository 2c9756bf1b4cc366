"""Watches the process of a solver for files that it must not open: those of the race, and those of other processes.

The data of timed calls are secret until their block begins, and this process must not read them in its parent's memory.
The watch begins before the solver's file is imported. An audit hook (PEP 578) cannot be removed, and sees every file
that Python opens and every folder that it lists; it does not see what compiled code does.
"""

import os
import sys
from collections.abc import Callable, Sequence

FILE_EVENTS = ("open", "os.listdir", "os.scandir")
MOST = 3
"""Largest number of reported actions."""


def install_audit_hook(folders: Sequence[str]) -> Callable[[], tuple[str, ...]]:
    """Watch from now on; returns a function that lists the forbidden actions so far as sentences."""
    actions: list[str] = []
    hidden = tuple(os.path.realpath(folder) + os.sep for folder in folders)
    # Bound here, so that a solver that replaces them cannot switch the guard off.
    absolute, is_number, this_process, separator = os.path.realpath, str.isdigit, str(os.getpid()), os.sep
    most, file_events = MOST, FILE_EVENTS

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        if (
            len(actions) < most
            and event in file_events
            and arguments
            and isinstance(arguments[0], str | bytes | os.PathLike)
        ):
            name = os.fsdecode(arguments[0])
            path = absolute(name) + separator
            _, root, process, *_ = (*path.split(separator), "", "")
            is_other_process = root == "proc" and is_number(process) and process != this_process
            if path.startswith(hidden) or is_other_process:
                actions.append(f"opened {name}")

    if hidden:
        sys.addaudithook(hook)
    return lambda: tuple(actions)
