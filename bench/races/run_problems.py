"""The problems of a run: made once, kept in its folder with their certificates, and loaded from there ever after."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from bench.passed.progress import Progress
from bench.problems import make
from bench.problems.protocol import RaceProblem
from bench.races.settings import RaceSettings
from bench.store import Run


def problems_of(run: Run, settings: RaceSettings, progress: Progress) -> Iterator[RaceProblem]:
    """Load the problems of the sets that were made and kept, and make the others; what is raced is what was kept."""
    for set_name in settings.problem_sets:
        kept = run.settings.get("problems", {}).get(set_name, ())
        if not kept or not all(run.problem_path(set_name, name).is_file() for name in kept):
            kept = list(_made(run, settings, set_name, progress))
            run.note(problems={**run.settings.get("problems", {}), set_name: kept})
        for i, name in enumerate(kept):
            progress(f"{set_name}/{name}", i + 1, len(kept))
            yield run.problem(set_name, name)


def _made(run: Run, settings: RaceSettings, set_name: str, progress: Progress) -> Iterator[str]:
    """Make the problems of a set and keep those that are not kept yet; yields their names."""
    made = make(set_name, settings.seed, settings.set_options)
    count = min(len(made), settings.limit or len(made))
    for i, problem in enumerate(islice(made.problems(), count)):
        progress(f"certified {set_name}/{problem.name}", i + 1, count)
        path = run.problem_path(set_name, problem.name)
        if not path.is_file():
            problem.save(path)
        yield problem.name
