"""The problems of a run: made once, kept in its folder, and loaded from there ever after.

While solvers run their proofs are in this process alone, and are written when all solvers have ended; a race that is
resumed before proves them again.
"""

from collections.abc import Iterable, Iterator
from itertools import islice

from bench.messages.progress import Progress
from bench.problems import ProblemSet, ProblemSetError, RaceProblem, make
from bench.races.settings import RaceSettings
from bench.store import ModelNote, Run
from piezo_model import IdentificationError


def left_out(run: Run) -> list[tuple[str, str]]:
    """Problems of the sets that are not raced, and why."""
    return [
        (f"{set_name}/{name}", why)
        for set_name, found in run.settings.get("left_out", {}).items()
        for name, why in found.items()
    ]


def problems_of(run: Run, settings: RaceSettings, progress: Progress) -> Iterator[RaceProblem]:
    """Load the problems of the sets that were made and kept, and make the others; what is raced is what was kept."""
    for set_name in settings.problem_sets:
        kept = run.settings.get("problems", {}).get(set_name, ())
        if kept and all(run.problem_path(set_name, name).is_file() for name in kept):
            for i, name in enumerate(kept):
                progress(f"{set_name}/{name}", i + 1, len(kept))
                yield run.problem(set_name, name)
        else:
            made = make(set_name, settings.seed, settings.set_options)
            _keep_model(run, made, progress)
            found = list(_made(run, settings, made, progress))
            run.note(problems={**run.settings.get("problems", {}), set_name: [problem.name for problem in found]})
            if made.left_out:
                run.note(left_out={**run.settings.get("left_out", {}), set_name: made.left_out})
            if not found:
                name, why = next(iter(made.left_out.items()))
                raise ProblemSetError(f"no problem of the set {set_name!r} can be raced; {name}: {why}")
            yield from found


def _keep_model(run: Run, made: ProblemSet, progress: Progress) -> None:
    """Keep the model of a recording with its error, or why there is none; the solvers are raced on it in any case."""
    progress(f"preparing {made.name}", 0, 1)
    note: ModelNote
    try:
        found = made.model()
    except IdentificationError as error:
        note = {"refused": str(error)}
    else:
        if found is None:
            return
        model, error_percent = found
        path = run.model_path(made.name)
        path.parent.mkdir(exist_ok=True)
        model.save(path)
        note = {"error_percent": error_percent}
    run.note(models={**run.settings.get("models", {}), made.name: note})


def keep_proofs(run: Run, problems: Iterable[RaceProblem]) -> None:
    """Write the problems with their proofs, now that no solver runs any more."""
    for problem in problems:
        problem.save(run.problem_path(problem.set_name, problem.name))


def _made(run: Run, settings: RaceSettings, made: ProblemSet, progress: Progress) -> Iterator[RaceProblem]:
    """Make the problems of a set, and keep those that are not kept yet and take those that are."""
    count = min(len(made), settings.limit or len(made))
    if count < len(made):
        run.note(there_are={**run.settings.get("there_are", {}), made.name: len(made)})
    for i, problem in enumerate(islice(made.problems(), count)):
        progress(f"certified {made.name}/{problem.name}", i + 1, count)
        path = run.problem_path(made.name, problem.name)
        if path.is_file():
            yield run.problem(made.name, problem.name)
        else:
            problem.save(path, proven=False)
            yield problem
