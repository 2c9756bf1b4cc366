"""What the report of any race has from its run: its title, scope and limits, machine, versions and settings."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from bench.report.report import Report
from bench.store import Run


def of_run(run: Run, title: str, report: Report) -> Report:
    """The report with these."""
    settings = run.settings
    machine, conditions = settings["machine"], settings.get("conditions", {})
    drift = (
        [f"the machine's speed drifted by {100.0 * conditions['sentinel_drift']:.0f} %"]
        if "sentinel_drift" in conditions
        else []
    )
    scope = [*([report.scope] if report.scope else []), f"{machine['processor']}, {machine['core']}", *drift]
    limits = [
        "One machine, one run: compare ratios, not microseconds.",
        *report.limits,
        *machine["warnings"],
        *conditions.get("warnings", []),
    ]
    return replace(
        report,
        title=f"{title} {run.path.name}",
        scope="; ".join(scope) + ".",
        limits=limits,
        environment=environment(settings),
    )


def environment(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Machine, versions and settings as names and texts."""
    machine = settings["machine"]
    field = ", ".join(f"{name} {version}" for name, version in settings.get("field", {}).items())
    absent = ", ".join(settings.get("absent", {}))
    left_out = "; ".join(
        f"{name}/{problem}: {why}"
        for name, found in settings.get("left_out", {}).items()
        for problem, why in found.items()
    )
    chosen = ", ".join(
        f"{name} {_said(value)}" for name, value in settings["settings"].items() if value not in ([], None)
    )
    return [
        (name, text)
        for name, text in (
            ("machine", f"{machine['processor']}, {machine['cores']} cores, {machine['system']}"),
            ("Python", f"{machine['python']}; " + ", ".join(f"{name} {v}" for name, v in machine["versions"].items())),
            ("settings", chosen),
            ("solvers", field),
            ("absent", absent),
            ("not raced", left_out),
        )
        if text
    ]


def _said(value: Any) -> str:
    if isinstance(value, list | dict):
        items = value.items() if isinstance(value, dict) else ((None, item) for item in value)
        return "(" + ", ".join(f"{name} {item}" if name else str(item) for name, item in items) + ")"
    return str(value)
