"""How the machine fares while a part of a race is timed: the sentinel's looks and the system's counters, kept as notes."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from bench.processes import sentinel
from bench.processes.engine import Workers
from bench.processes.sentinel import Sentinel
from bench.store import Run
from bench.timing import machine
from piezo_model.atomic_file import replacing


@contextmanager
def watched(run: Run, name: str, watcher: Sentinel) -> Iterator[dict[str, Any]]:
    """Watch what is done inside; the notes of that name, with what is put into the mapping, are written when it is done."""
    more: dict[str, Any] = {}
    watcher.look()
    before = machine.counters()
    yield more
    between = machine.between(before, machine.counters())
    watcher.look()
    run.save_notes(name, {"host": os.uname().nodename, "core": watcher.core, "sentinel": watcher.taken(), **between, **more})


def note_conditions(run: Run, workers: Workers, more: Sequence[str] = ()) -> None:
    """Keep how the machine fared while it timed, and say what makes the times less certain, ``more`` of which the race knows itself."""
    notes = run.all_notes()
    looks = sentinel.table(notes)
    with replacing(run.path / "sentinel.parquet") as temporary:
        looks.to_parquet(temporary, index=False)
    run.note(conditions={
        "sentinel_drift": sentinel.drift(looks), "parts": [{name: value for name, value in note.items() if name != "sentinel"}
                                                           for note in notes],
        "warnings": [*sentinel.sentences(looks), *machine.disturbances(notes, workers.count), *more]})
