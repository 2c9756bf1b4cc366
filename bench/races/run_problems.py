"""The problems of a run: generated once, saved in its folder, and loaded from there afterwards.

While solvers run, only this process knows the certificates of new problems; they are saved when all solvers have
ended. A race that is resumed before that certifies the problems again.
"""

from collections.abc import Iterable, Iterator
from itertools import islice

from bench.messages.progress import Progress
from bench.problems import ProblemSet, ProblemSetError, RaceProblem, make
from bench.races.settings import RaceSettings
from bench.store import ModelNote, Run
from piezo_model import IdentificationError


def left_out(run: Run) -> list[tuple[str, str]]:
    """Problems of the sets that are not raced, and the reasons."""
    return [
        (f"{set_name}/{name}", reason)
        for set_name, reasons in run.settings.get("left_out", {}).items()
        for name, reason in reasons.items()
    ]


def problems_of(run: Run, settings: RaceSettings, progress: Progress) -> Iterator[RaceProblem]:
    """Load the problems of the sets if all were saved; otherwise generate and save those that are missing."""
    for set_name in settings.problem_sets:
        names = run.settings.get("problems", {}).get(set_name, ())
        if names and all(run.problem_path(set_name, name).is_file() for name in names):
            for i, name in enumerate(names):
                progress(f"{set_name}/{name}", i + 1, len(names))
                yield run.problem(set_name, name)
        else:
            problem_set = make(set_name, settings.seed, settings.set_options)
            _save_model(run, problem_set, progress)
            problems = list(_generate(run, settings, problem_set, progress))
            run.note_of_set(set_name, problems=[problem.name for problem in problems])
            if problem_set.left_out:
                run.note_of_set(set_name, left_out=problem_set.left_out)
            if not problems:
                name, reason = next(iter(problem_set.left_out.items()))
                raise ProblemSetError(f"no problem of the set {set_name!r} can be raced; {name}: {reason}")
            yield from problems


def _save_model(run: Run, problem_set: ProblemSet, progress: Progress) -> None:
    """Save the model of a recording and note its error, or the reason for its absence; the problems are raced in either
    case."""
    progress(f"preparing {problem_set.name}", 0, 1)
    note: ModelNote = {"digests": problem_set.digests()}
    try:
        identified = problem_set.model()
    except IdentificationError as error:
        note["refused"] = str(error)
    else:
        if identified is None:
            return
        model, error_percent = identified
        path = run.model_path(problem_set.name)
        path.parent.mkdir(exist_ok=True)
        model.save(path)
        note["error_percent"], note["creep"] = error_percent, model.report["creep"]["sentence"]
    run.note_of_set(problem_set.name, models=note)


def save_certificates(run: Run, problems: Iterable[RaceProblem]) -> None:
    """Save the problems again, with their certificates, when no solver runs any more."""
    for problem in problems:
        problem.save(run.problem_path(problem.set_name, problem.name))


def _generate(run: Run, settings: RaceSettings, problem_set: ProblemSet, progress: Progress) -> Iterator[RaceProblem]:
    """Generate the problems of a set and save them without certificates; those that were saved before are loaded."""
    count = min(len(problem_set), settings.limit or len(problem_set))
    if count < len(problem_set):
        run.note_of_set(problem_set.name, there_are=len(problem_set))
    for i, problem in enumerate(islice(problem_set.problems(), count)):
        progress(f"certified {problem_set.name}/{problem.name}", i + 1, count)
        path = run.problem_path(problem_set.name, problem.name)
        if path.is_file():
            yield run.problem(problem_set.name, problem.name)
        else:
            problem.save(path, proven=False)
            yield problem
