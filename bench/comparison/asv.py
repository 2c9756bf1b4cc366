"""Runs as results of airspeed velocity (asv), which draws a solver's history and compares commits.

Format: version 2 of a result file and version 1 of ``machine.json``, and ``benchmarks.json`` that describes the
benchmarks; https://asv.readthedocs.io. Each solver lane is two benchmarks: the median time of an answer over the tasks
of a run, in seconds, and the sum of their iterations.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.derived.measurements import Measurements
from bench.messages.task import Status
from bench.store import Run, RunError
from piezo_model.atomic_file import replacing

ENVIRONMENT = "race"
"""Name of the environment of all results; asv compares results of the same environment."""
BENCHMARK: dict[str, Any] = {"version": "1", "params": [], "param_names": [], "timeout": 0.0, "code": ""}
RESULT: dict[str, Any] = {
    "version": 2,
    "env_name": ENVIRONMENT,
    "date": 0,
    "python": "",
    "requirements": {},
    "env_vars": {},
    "durations": {},
    "result_columns": ["result", "params"],
}
"""What all benchmarks and all results have in common."""


def asv_files(runs: Sequence[Run], measured: Sequence[Measurements], solver: str) -> dict[str, dict[str, Any]]:
    """Contents of the files of a folder of results, by their names in it; RunError for a run without a commit or the
    solver."""
    files: dict[str, dict[str, Any]] = {}
    described: dict[str, Any] = {}
    for run, found in zip(runs, measured, strict=True):
        machine = run.machine_of(found.rows)
        environment = machine.get("environment", {})
        commit = environment.get("commit", "").rstrip("+")
        if not commit:
            raise RunError(f"{run.path} does not know the commit that it ran from, by which asv orders results")
        rows = found.field[(found.field.solver == solver) & (found.field.status == Status.OK)]
        if not len(rows):
            raise RunError(f"{run.path} has no answer of {solver}")
        results = {}
        for lane, part in rows.groupby("lane"):
            for what, kind, unit, value in (
                ("time", "time", "seconds", float(part.answer_us.median()) * 1e-6),
                ("iterations", "track", "iterations", float(part.iterations.clip(lower=0).sum())),
            ):
                name = f"{solver}.{lane}.{what}"
                results[name] = [[value if math.isfinite(value) else None], []]
                described[name] = {**BENCHMARK, "name": name, "unit": unit, "type": kind}
        about = {"machine": found.host, "cpu": machine["processor"], "os": machine["system"]}
        files[f"{found.host}/machine.json"] = {**about, "version": 1}
        name = f"{found.host}/{commit[:8]}-{ENVIRONMENT}.json"
        if name in files:
            raise RunError(f"{run.path} is of commit {commit}, as a run before it, and asv has one result a commit")
        files[name] = {**RESULT, "commit_hash": commit, "params": about, "results": results}
    return {**files, "benchmarks.json": {**described, "version": 2}}


def write_asv(runs: Sequence[Run], measured: Sequence[Measurements], solver: str, folder: Path) -> None:
    """Write or replace the files in a folder of results."""
    for name, content in asv_files(runs, measured, solver).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with replacing(folder / name) as temporary:
            temporary.write_text(json.dumps(content, indent=1))
