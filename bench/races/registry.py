"""The folder is the registry: each folder beside this file with a ``kind.py`` is one kind of race."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pathlib import Path

from bench.races.kind import Kind
from bench.races.settings import settings_of
from bench.store import Run, RunError

DEFAULT = "oneshot"


@cache
def kinds() -> dict[str, Kind]:
    """The kinds of race by name, the default one first."""
    names = sorted((path.parent.name for path in Path(__file__).parent.glob("*/kind.py")), key=lambda name: (name != DEFAULT, name))
    return {name: import_module(f"{__package__}.{name}.kind").KIND for name in names}


def kind_of(run: Run) -> Kind:
    """The kind of a run; RunError where its run.json names none that is known."""
    name = run.settings.get("race", DEFAULT)
    if name not in kinds():
        raise RunError(f"{run.path / 'run.json'}: there is no race {name[:60]!r}; known are {', '.join(kinds())}")
    return kinds()[name]


def open_run(path: Path) -> Run:
    """Open a run of a kind that is known, with settings that such a run can have; RunError says what is wrong with it."""
    run = Run.open(path)
    settings_of(run, kind_of(run).settings)
    return run
