"""A run is a folder, and every finished task is in it before the next one starts.

    results/<run>/run.json        settings, seed, versions, machine
                  problems/       the problems with their certificates, NPZ
                  tasks/          while the race runs one NPZ a finished task, and notes as JSON
                  rows.parquet    one row a task            } written at the end
                  times.parquet   raw nanoseconds           }
                  sentinel.parquet                          }
                  summary.csv, report.md

Each file is written beside its place, flushed and renamed, so that an interruption at any moment leaves whole files
only, and a resumed run finds what is done by the names of its files.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.passed.row import Row
from bench.passed.task import Task
from bench.problem_files.program import ProblemFileError
from bench.problems.protocol import RaceProblem
from piezo_model.atomic_file import replacing, write_text

VERSION = 2
"""Of run folders: another number says that settings, columns or what they mean have changed, so that no rows are misread."""


@dataclass(frozen=True)
class Schema:
    """The table of one kind of race."""

    file: str
    columns: tuple[str, ...]
    order: tuple[str, ...]
    """Columns by which the rows are sorted."""
    gathered: Callable[[list[Row]], list[Row]] = list
    """What becomes of the rows of all tasks."""


class RunError(ValueError):
    """A run that is not there or not whole; the message is one sentence."""


class Run:
    """One run's folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, results: Path, settings: Mapping[str, Any], name: str | None = None) -> Run:
        """Make a new folder, named by the time unless a name is given, and write ``run.json``.

        It is made beside its place and renamed, so that a run that is there can be resumed.
        """
        name = datetime.now(UTC).strftime("%Y%m%d-%H%M%S") if name is None else name
        if not name or Path(name).name != name or name.startswith("."):
            raise RunError(f"a run has the name of one folder, without slash and leading dot, and not {name!r}")
        run = cls(results / name)
        if run.path.exists():
            raise RunError(f"{run.path}: is there already; give another name or resume it")
        try:
            results.mkdir(parents=True, exist_ok=True)
            made = Path(tempfile.mkdtemp(prefix=f".{name}.", dir=results))
        except OSError as error:
            raise RunError(f"{run.path}: cannot be made ({error.strerror})") from None
        try:
            for folder in ("problems", "tasks"):
                (made / folder).mkdir()
            write_text(made / "run.json", json.dumps({**settings, "version": VERSION}, indent=1) + "\n")
            made.chmod(results.stat().st_mode & 0o777)  # mkdtemp is private
            made.rename(run.path)
        except OSError as error:
            shutil.rmtree(made)
            raise RunError(f"{run.path}: cannot be made ({error.strerror})") from None
        return run

    @classmethod
    def open(cls, path: Path) -> Run:
        """Open a run that is there, if it is of this version; the first runs do not say that they are of version 1."""
        if not (path / "run.json").is_file():
            raise RunError(f"{path}: is not a run folder: it has no run.json")
        run = cls(path)
        if (version := run.settings.get("version", 1)) != VERSION:
            raise RunError(f"{path / 'run.json'}: version {version!r} is not {VERSION}, the one this program reads")
        return run

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other processes from this run; the lock goes with the process, however that ends."""
        folder = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise RunError(f"{self.path}: another process is at work on this run") from None
        else:
            yield
        finally:
            os.close(folder)

    @property
    def settings(self) -> dict[str, Any]:
        """What ``run.json`` says."""
        try:
            settings = json.loads((self.path / "run.json").read_text(encoding="utf-8"))
        except json.JSONDecodeError as error:
            raise RunError(f"{self.path / 'run.json'}: is not a whole JSON file ({error})") from None
        if not isinstance(settings, dict):
            raise RunError(f"{self.path / 'run.json'}: does not hold settings")
        return settings

    def note(self, **notes: Any) -> None:
        """Add to ``run.json`` what JSON can hold."""
        write_text(self.path / "run.json", json.dumps({**self.settings, **notes}, indent=1) + "\n")

    def note_field(self, versions: Mapping[str, str], absent: Mapping[str, str]) -> None:
        """Add the versions of the field to ``run.json``, and why others that were asked for are absent."""
        self.note(field=dict(versions), absent=dict(absent))

    def problem_path(self, problem_set: str, problem: str) -> Path:
        """Where a problem is kept."""
        return self.path / "problems" / f"{problem_set}--{problem}.npz"

    def problem(self, problem_set: str, name: str) -> RaceProblem:
        """Load a problem of the run; RunError says in one sentence what is wrong with its file."""
        path = self.problem_path(problem_set, name)
        if not path.is_file():
            raise RunError(f"{path}: is not there, or not from {os.uname().nodename}, so the problem cannot be raced")
        try:
            return RaceProblem.load(path)
        except ProblemFileError as error:
            raise RunError(f"{error}; remove the file and resume the run, and it is made again") from None

    def is_done(self, task: Task) -> bool:
        """Whether the task's row is on disk, and whole."""
        return zipfile.is_zipfile(self._task_path(task))

    def _task_path(self, task: Task) -> Path:
        return self.path / "tasks" / f"{task.key}.npz"

    def save(self, task: Task, row: Mapping[str, Any] | Sequence[Mapping[str, Any]], times: Mapping[str, Any]) -> None:
        """Put one finished task on disk, with its row or its rows and its raw times by what was timed."""
        with replacing(self._task_path(task), durable=False) as temporary, temporary.open("wb") as file:
            np.savez(file, row=np.array(json.dumps(row)), **times)

    def task(self, task: Task) -> tuple[list[Row], dict[str, Any]]:
        """Rows and raw times of a task that is done."""
        with np.load(self._task_path(task), allow_pickle=False) as data:
            return _rows(data), {what: data[what] for what in data.files if what != "row"}

    def save_notes(self, name: str, notes: Mapping[str, Any]) -> None:
        """Keep what was noted of a part of the race; that they are there says that the part is done."""
        os.sync()  # its tasks, which were not flushed one by one
        write_text(self.path / "tasks" / f"{name}.json", json.dumps(notes))

    def has_notes(self, name: str) -> bool:
        """Whether there are notes of that name."""
        return (self.path / "tasks" / f"{name}.json").is_file()

    def all_notes(self) -> list[dict[str, Any]]:
        """The notes of all parts of a race that is not finished."""
        return [json.loads(path.read_text(encoding="utf-8"))
                for path in sorted((self.path / "tasks").glob("[!.]*.json"))]

    def is_finished(self, schema: Schema) -> bool:
        """Whether the tables were written."""
        return (self.path / schema.file).is_file() and not (self.path / "tasks").exists()

    def finish(self, schema: Schema) -> None:
        """Gather the tasks into tables; the single files go only after the tables are whole, and all at once."""
        rows, times = [], []
        for path in sorted((self.path / "tasks").glob("[!.]*.npz")):  # an interrupted write leaves a hidden file
            with np.load(path, allow_pickle=False) as data:
                some = _rows(data)
                rows += some
                of = {"task": some[0]["task"], "repeat": some[0].get("repeat", 0)}
                times += [{**of, "what": what, "ns": data[what]} for what in data.files if what != "row"]
        table = pd.DataFrame(schema.gathered(rows), columns=["task", *schema.columns]).sort_values(list(schema.order),
                                                                                                  ignore_index=True)
        with replacing(self.path / "times.parquet") as temporary:
            pd.DataFrame(times, columns=["task", "repeat", "what", "ns"]).to_parquet(temporary, index=False)
        with replacing(self.path / schema.file) as temporary:
            table.to_parquet(temporary, index=False)
        shutil.rmtree((self.path / "tasks").rename(self.path / ".tasks"))

    def rows(self, schema: Schema) -> pd.DataFrame:
        """Return the table of a finished run."""
        return self._table(schema.file, schema.columns)

    def times(self) -> pd.DataFrame:
        """Return the raw times of a finished run: task, what was timed, nanoseconds."""
        return self._table("times.parquet", ("task", "what", "ns"))

    def _table(self, file: str, columns: Sequence[str]) -> pd.DataFrame:
        path = self.path / file
        if not path.is_file():
            raise RunError(f"{self.path}: has no {file}; the run was not finished, so resume it")
        try:
            rows = pd.read_parquet(path)
        except (OSError, ValueError) as error:
            raise RunError(f"{path}: cannot be read ({error})") from None
        missing = [name for name in columns if name not in rows.columns]
        if missing:
            raise RunError(f"{path}: has no column {missing[0]!r}")
        return rows


def _rows(data: Mapping[str, Any]) -> list[Row]:
    """The rows of a task's file, which holds one or several."""
    found = json.loads(str(data["row"]))
    return found if isinstance(found, list) else [found]
