"""The problems of a run: generated once, saved in its folder, and loaded from there afterwards.

While solvers run, only this process knows the certificates of new problems; they are saved when all solvers have
ended. A race that is resumed before that certifies the problems again.
"""

from collections.abc import Iterable, Iterator, Sequence

from bench.messages.task import Progress
from bench.problems import ProblemSet, ProblemSetError, RaceProblem, make
from bench.races.settings import RaceSettings
from bench.store import ModelNote, Run
from piezo_model import IdentificationError


def raced(settings: RaceSettings, set_name: str, names: Sequence[str]) -> Sequence[str]:
    """The problems of a set that are raced: those that the settings name, or as many as they permit, evenly spread over
    the set, so that a few are of different actuators and drives.

    Examples
    --------
    >>> raced(RaceSettings(limit=3), "digits", "0123456789")
    ['0', '3', '6']
    >>> raced(RaceSettings(problems=("digits/7", "x")), "digits", "0123456789")
    ['7']
    """
    if settings.problems:
        return [name for name in names if {name, f"{set_name}/{name}"} & {*settings.problems}]
    count = min(settings.limit or len(names), len(names))
    return [names[i * len(names) // count] for i in range(count)]


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
            for i, name in enumerate(raced(settings, set_name, names)):
                progress(f"{set_name}/{name}", i + 1, len(names))
                yield run.problem(set_name, name)
        else:
            problem_set = make(set_name, settings.seed, settings.set_options)
            problem_set.selected = {*raced(settings, set_name, problem_set.names())}
            if problem_set.selected:
                yield from _generated(run, problem_set, progress)


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


def _generated(run: Run, problem_set: ProblemSet, progress: Progress) -> Sequence[RaceProblem]:
    """Generate the problems of a set and save them without certificates; those that were saved before are loaded."""
    set_name, count, there_are = problem_set.name, len(problem_set.selected), len(problem_set.names())
    _save_model(run, problem_set, progress)
    problems: list[RaceProblem] = []
    for made in problem_set.problems():
        if made.name in problem_set.selected:
            progress(f"certified {set_name}/{made.name}", len(problems) + 1, count)
            path = run.problem_path(set_name, made.name)
            if path.is_file():
                problems.append(run.problem(set_name, made.name))
            else:
                made.save(path, proven=False)
                problems.append(made)
    names = [problem.name for problem in problems]
    notes = {"problems": names, "there_are": count < there_are and there_are, "left_out": problem_set.left_out}
    run.note_of_set(set_name, **{name: note for name, note in notes.items() if note})
    if not problems:
        name, reason = next(iter(problem_set.left_out.items()))
        raise ProblemSetError(f"no problem of the set {set_name!r} can be raced; {name}: {reason}")
    return problems
