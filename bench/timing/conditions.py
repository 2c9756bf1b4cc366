"""How the machine fares while a part of a race is timed: the sentinel's looks and the system's counters, kept as notes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from bench.store import Run
from bench.timing import machine
from bench.timing.sentinel import Sentinel


@contextmanager
def watched(run: Run, name: str, sentinel: Sentinel) -> Iterator[dict[str, Any]]:
    """Watch what is done inside; the notes of that name, with what is put into the mapping, are written when it is done."""
    more: dict[str, Any] = {}
    sentinel.look()
    before = machine.counters()
    yield more
    between = machine.between(before, machine.counters())
    sentinel.look()
    run.save_notes(name, {"host": os.uname().nodename, "core": sentinel.core, "sentinel": sentinel.taken(), **between, **more})
