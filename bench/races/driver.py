"""The driver of a race: it starts the solvers, does the tasks that are not done yet, and monitors the machine.

Tasks are grouped in parts, each run by one worker in one go (`passes`). Every finished task is saved before the next
one starts; the notes of a part (its host, disturbances, the sentinel's samples) come last and mark it as done. The
parts of a pass may be done in any order, and the next pass follows from the rows of the earlier ones.
"""

from contextlib import ExitStack
from functools import partial

from bench.messages import user_cache
from bench.messages.task import ChildSettings, Progress, Task
from bench.processes import engine, sentinel
from bench.processes.solver_child import SolverPool
from bench.races import null_solver
from bench.races.lanes import checked, lanes_here
from bench.races.race import passes
from bench.races.run_problems import problems_of, save_certificates
from bench.races.settings import RaceSettings
from bench.store import Run
from bench.timing import cores, machine
from piezo_model.atomic_file import replacing


def run_tasks(run: Run, settings: RaceSettings, progress: Progress, workers: engine.Workers) -> None:
    """Do the tasks that are not done yet; the certificates, which solvers must not see, are saved at the end."""
    done, total = 0, 0

    def tell(task: Task) -> None:
        nonlocal done
        progress(str(task), done, total)
        done += 1

    entries = (null_solver.ENTRY, *checked(settings))
    hidden = (str(run.path.resolve()), str(user_cache.folder()))
    limits, core = ChildSettings(settings.time_limit_s, settings.memory_mb, hidden), None
    with ExitStack() as resources:
        problems = list(problems_of(run, settings, progress))
        if workers.is_single:
            core = resources.enter_context(cores.claim()).number
        pool = resources.enter_context(SolverPool(entries, limits, core))
        lanes = lanes_here(run, pool)
        if not workers.is_single:
            pool.close()
        map_unordered = resources.enter_context(engine.started(workers))
        for parts in passes(run, settings, lanes, problems):
            total += sum(len(part.tasks) for part in parts)
            if workers.is_single:
                for part in parts:
                    part.do(pool, tell)
            else:
                function = partial(engine.work, entries=entries, settings=limits)
                for part in map_unordered(function, parts):
                    for task in part.tasks:
                        tell(task)
    save_certificates(run, problems)
    note_conditions(run)


def note_conditions(run: Run) -> None:
    """Save the condition of the machine during the race, with warnings about less certain times."""
    notes = [part.notes for part in run.parts() if part.notes is not None]
    samples = sentinel.table(notes)
    with replacing(run.path / "sentinel.parquet") as temporary:
        samples.to_parquet(temporary, index=False)
    run.note(
        conditions={
            "sentinel_drift": sentinel.drift(samples),
            "parts": [{name: value for name, value in note.items() if name != "sentinel"} for note in notes],
            "warnings": [*sentinel.sentences(samples), *machine.disturbances(notes)],
        }
    )
