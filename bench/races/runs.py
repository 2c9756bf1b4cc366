"""A run of a race: how it is started, resumed and reported."""

from dataclasses import asdict, replace
from pathlib import Path

from bench.messages.task import Progress
from bench.processes.engine import Workers
from bench.races.lanes import checked
from bench.races.race import run_tasks
from bench.races.report import report
from bench.races.run_problems import left_out
from bench.races.settings import RaceSettings
from bench.report.report import Report
from bench.report.words import joined, settings_label
from bench.report.writing import write_report
from bench.store import Run, RunError
from piezo_model.json_file import brief, convert


def settings_of(run: Run) -> RaceSettings:
    """The settings of a run; RunError if they are not those of a race."""
    try:
        return convert(run.settings["settings"], RaceSettings)
    except ValueError as error:
        raise RunError(
            f"{run.path / 'run.json'}: does not hold the settings of a race: {brief(error)}; if an earlier version "
            "of piezobench made the run, race again"
        ) from None


def open_run(path: Path) -> Run:
    """Open a run and check its settings; RunError if they do not fit."""
    run = Run.open(path)
    settings_of(run)
    return run


def start(results: Path, settings: RaceSettings, name: str) -> Run:
    """Create the folder of a run; RaceError, RunError or ProblemSetError if the race cannot be run."""
    checked(settings)
    return Run.create(results, {"settings": asdict(settings)}, name)


def carry_on(run: Run, progress: Progress, workers: Workers) -> None:
    """Do the tasks that are not done yet, and gather the tables."""
    workers.check()
    with run.exclusive():
        run_tasks(run, settings_of(run), progress, workers)
        progress("gathering the tables", 0, 1)
        run.finish()


def write(run: Run) -> tuple[Report, Path]:
    """Write ``report.md``, ``report.html`` and their files; returns the report and the path of ``report.md``."""
    result = report(run, settings_of(run))
    machines, conditions = [*run.machines.values()], run.settings.get("conditions", {})
    hosts = {part["host"] for part in conditions.get("parts", ())} or {*run.machine_names}
    scope = [result.scope, joined(sorted({f"{host['processor']}, {host['core']}" for host in machines}))]
    if "sentinel_drift" in conditions:
        scope.append(f"the machine's speed drifted by {100.0 * conditions['sentinel_drift']:.0f} %")
    limits = [
        f"{'One machine' if len(hosts) == 1 else f'{len(hosts)} hosts'}, one run: compare ratios, not microseconds.",
        *dict.fromkeys(warning for host in machines for warning in host["warnings"]),
        *conditions.get("warnings", []),
    ]
    result = replace(
        result,
        title=f"Race {run.path.name}",
        scope="; ".join(filter(None, scope)) + ".",
        notes=[*filter(None, [result.failed]), *result.notes],
        limits=limits,
        environment=environment(run),
    )
    return result, write_report(result, run.path)


def environment(run: Run) -> list[tuple[str, str]]:
    """Names and texts about machine, versions and settings."""
    settings = run.settings
    chosen = {
        name: joined(value) if isinstance(value, list) else value
        for name, value in settings["settings"].items()
        if value not in ([], {}, None, "")
    }
    entries: list[tuple[str, str]] = []
    for host in run.machines.values():
        entries += [
            ("machine", f"{host['processor']}, {host['cores']} cores, {host['system']}"),
            ("Python", f"{host['python']}; {', '.join(map(' '.join, host['versions'].items()))}"),
            ("commit", host.get("environment", {}).get("commit", "")),
        ]
    entries += [
        ("settings", settings_label(chosen)),
        ("solvers", ", ".join(map(" ".join, settings.get("lanes", {}).items()))),
        ("absent", ", ".join(settings.get("absent", {}))),
        ("not raced", "; ".join(f"{name}: {reason}" for name, reason in left_out(run))),
    ]
    return [(name, text) for name, text in entries if text]
