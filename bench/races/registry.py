"""The folder is the registry: each ``kind.py`` in a folder beside this file has a kind of race, or several that share all but settings and report."""

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
    found = [each for name in names for each in vars(import_module(f"{__package__}.{name}.kind")).values() if isinstance(each, Kind)]
    return {each.name: each for each in found}


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
