"""A run is a folder, and every finished task is in it before the next one starts.

    results/<run>/run.json        settings, seed, versions, machine
                  problems/       the problems with their certificates, NPZ
                  models/         the model of a recording that is raced on, JSON
                  tasks/          while the race runs one NPZ a finished task, and notes as JSON
                  rows.parquet    one row a task            } written at the end
                  times.parquet   raw nanoseconds           }
                  sentinel.parquet                          }
                  summary.csv, report.md

Each file is written beside its place, flushed and renamed, so that an interruption at any moment leaves whole files
only, and a resumed run finds what is done by the names of its files.
"""

import fcntl
import json
import math
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NotRequired, Self, TypedDict

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from bench.messages import columns
from bench.messages.task import Row, Task
from bench.problem_files import npz
from bench.problem_files.program import ProblemFileError
from bench.problems.protocol import RaceProblem
from piezo_model import json_file
from piezo_model.atomic_file import replacing, write_text
from piezo_model.json_file import FileName, decoded, packed, unpacked

VERSION = 3
"""Of run folders: another number says that settings, columns or what they mean have changed, so that no rows are
misread."""


TIMES = columns.schema(("task", "repeat", "what", "ns"))
LOOKS = columns.schema(("host", "core", "at_s", "ns", "level_ns", "ratio"))


@dataclass(frozen=True)
class Schema:
    """The table of one kind of race."""

    file: str
    columns: tuple[str, ...]
    order: tuple[str, ...]
    """Columns by which the rows are sorted."""
    types: Mapping[str, pa.DataType] = field(default_factory=dict)
    """Of columns that `columns` does not know and that hold no doubles."""

    @property
    def arrow(self) -> pa.Schema:
        """Columns with their types."""
        return columns.schema(("task", *self.columns), self.types)

    def row(self, **known: Any) -> Row:
        """A row of what is known: elsewhere no text, 0, False, or no number."""
        nothing = {pa.large_string(): "", pa.int64(): 0, pa.bool_(): False}
        return {field.name: nothing.get(field.type, math.nan) for field in self.arrow} | known


class RunError(ValueError):
    """A run that is not there or not whole; the message is one sentence."""


class Machine(TypedDict):
    """What `timing.machine` says of itself."""

    processor: str
    cores: int | None
    system: str
    python: str
    core: str
    """Compiler and instruction set of our C core."""
    versions: dict[str, str]
    load_at_start: list[float]
    warnings: list[str]


class Notes(TypedDict):
    """What was noted of a part of a race."""

    host: str
    core: int
    sentinel: NotRequired[list[tuple[float, list[int]]]]
    seconds: float
    throttled: int
    steal_percent: float
    switches: int
    busy_cores: float
    preemptions: NotRequired[int]
    timed_calls: NotRequired[int]


class Conditions(TypedDict):
    """How the machine fared."""

    sentinel_drift: float
    parts: list[Notes]
    warnings: list[str]


class Planned(TypedDict):
    """What a one-shot race has in its second pass of a solver lane."""

    scaling: str
    solver: str
    lane: str
    setting: str
    longer: bool
    """Whether it is timed longer than in the first."""


class ModelNote(TypedDict):
    """What was found of the model of a recording: its error on what it has not seen, per cent of the range, or why
    there is none."""

    error_percent: NotRequired[float]
    refused: NotRequired[str]


class RunFile(TypedDict):
    """``run.json``; the settings are those of the kind of race."""

    race: NotRequired[str]
    settings: dict[str, Any]
    machine: Machine
    version: NotRequired[int]
    problems: NotRequired[dict[FileName, list[FileName]]]
    there_are: NotRequired[dict[str, int]]
    """Problems of the sets of which not all are raced."""
    left_out: NotRequired[dict[str, dict[str, str]]]
    models: NotRequired[dict[str, ModelNote]]
    field: NotRequired[dict[str, str]]
    absent: NotRequired[dict[str, str]]
    second_pass: NotRequired[list[Planned]]
    conditions: NotRequired[Conditions]


class Run:
    """One run's folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, results: Path, settings: Mapping[str, Any], name: str | None = None) -> Self:
        """Make a new folder, named by the time unless a name is given, and write ``run.json``.

        It is made beside its place and renamed, so that a run that is there can be resumed.
        """
        name = datetime.now(UTC).strftime("%Y%m%d-%H%M%S") if name is None else name
        if not name or not name.isprintable() or Path(name).name != name or name.startswith((".", "-")):
            raise RunError(
                "a run has the name of one folder, on one line, without slash and leading dot or dash, and "
                f"not {name!r}"
            )
        run = cls(results / name)
        if run.path.exists():
            raise RunError(f"{run.path} is there already; give another name or resume it")
        try:
            results.mkdir(parents=True, exist_ok=True)
            made = Path(tempfile.mkdtemp(prefix=f".{name}.", dir=results))
        except OSError as error:
            raise RunError(f"{run.path} cannot be made ({error.strerror})") from None
        try:
            for folder in ("problems", "tasks"):
                (made / folder).mkdir()
            write_text(made / "run.json", json.dumps({**settings, "version": VERSION}, indent=1) + "\n")
            made.chmod(results.stat().st_mode & 0o777)  # mkdtemp is private
            made.rename(run.path)
        except OSError as error:
            shutil.rmtree(made)
            raise RunError(f"{run.path} cannot be made ({error.strerror})") from None
        return run

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open a run that is there, if it is of this version; the first runs do not say that they are of version 1."""
        if not (path / "run.json").is_file():
            raise RunError(f"{path} is not a run folder: it has no run.json")
        run = cls(path)
        if (version := json_file.read(path / "run.json", dict[str, Any], RunError).get("version", 1)) != VERSION:
            raise RunError(
                f"{path / 'run.json'}: version {version!r:.60} is not {VERSION}, the one this program reads; race again"
            )
        return run

    def discard(self) -> None:
        """Remove the folder, unless a task of it is done."""
        if not self._done():
            shutil.rmtree(self.path)

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
    def settings(self) -> RunFile:
        """What ``run.json`` says."""
        return json_file.read(self.path / "run.json", RunFile, RunError)

    def note(self, **notes: Any) -> None:
        """Add to ``run.json`` what JSON can hold."""
        write_text(self.path / "run.json", json.dumps({**self.settings, **notes}, indent=1) + "\n")

    def problem_path(self, problem_set: str, problem: str) -> Path:
        """Where a problem is kept."""
        return self.path / "problems" / f"{problem_set}--{problem}.npz"

    def model_path(self, problem_set: str) -> Path:
        """Where the model of the recording that a set is made of is kept."""
        return self.path / "models" / f"{problem_set}.json"

    def problem(self, problem_set: str, name: str) -> RaceProblem:
        """Load a problem of the run; RunError says in one sentence what is wrong with its file."""
        path = self.problem_path(problem_set, name)
        if not path.is_file():
            raise RunError(f"{path} is not there, or not from {os.uname().nodename}, so the problem cannot be raced")
        try:
            return RaceProblem.load(path)
        except ProblemFileError as error:
            raise RunError(f"{error}; remove the file and resume the run, and it is made again") from None

    def _done(self) -> list[Path]:
        """The files of the tasks that are done; an interrupted write leaves a hidden one."""
        return sorted((self.path / "tasks").glob("[!.]*.npz"))

    def is_done(self, task: Task) -> bool:
        """Whether the task's row is on disk, and whole."""
        return zipfile.is_zipfile(self._task_path(task))

    def _task_path(self, task: Task) -> Path:
        return self.path / "tasks" / f"{task.key}.npz"

    def save(self, task: Task, rows: Sequence[Mapping[str, Any]], times: Mapping[str, Any]) -> None:
        """Put one finished task on disk, with its rows and its raw times by what was timed."""
        with replacing(self._task_path(task), durable=False) as temporary, temporary.open("wb") as file:
            np.savez(file, rows=np.array(json.dumps(packed(rows))), **times)

    def task(self, task: Task) -> tuple[list[Row], dict[str, Any]]:
        """Rows and raw times of a task that is done."""
        with _opened(self._task_path(task)) as data:
            return _rows(data), {what: data[what] for what in data.files if what != "rows"}

    def rows_so_far(self) -> list[Row]:
        """The rows of all tasks of a race that is not finished."""
        found: list[Row] = []
        for path in self._done():
            with _opened(path) as data:
                found += _rows(data)
        return found

    def save_notes(self, name: str, notes: Mapping[str, Any]) -> None:
        """Keep what was noted of a part of the race; that they are there says that the part is done."""
        os.sync()  # its tasks, which were not flushed one by one
        write_text(self.path / "tasks" / f"{name}.json", json.dumps(notes))

    def has_notes(self, name: str) -> bool:
        """Whether there are notes of that name."""
        return (self.path / "tasks" / f"{name}.json").is_file()

    def all_notes(self) -> list[Notes]:
        """The notes of all parts of a race that is not finished."""
        return [json_file.read(path, Notes, RunError) for path in sorted((self.path / "tasks").glob("[!.]*.json"))]

    def is_finished(self, schema: Schema) -> bool:
        """Whether the tables were written."""
        return (self.path / schema.file).is_file() and not (self.path / "tasks").exists()

    def finish(self, schema: Schema) -> None:
        """Gather the tasks into tables; the single files go only after the tables are whole, and all at once."""
        rows, times = [], []
        for path in self._done():
            with _opened(path) as data:
                some = _rows(data)
                rows += some
                of = {"task": some[0]["task"], "repeat": some[0].get("repeat", 0)}
                times += [{**of, "what": what, "ns": data[what]} for what in data.files if what != "rows"]
        table = pa.Table.from_pylist(rows, schema.arrow).sort_by([(name, "ascending") for name in schema.order])
        for file, whole in (("times.parquet", pa.Table.from_pylist(times, TIMES)), (schema.file, table)):
            with replacing(self.path / file) as temporary:
                parquet.write_table(whole, temporary)
        shutil.rmtree((self.path / "tasks").rename(self.path / ".tasks"))

    def rows(self, schema: Schema) -> pd.DataFrame:
        """Return the table of a finished run."""
        return self._table(schema.file, schema.arrow, ("task", *schema.order))

    def times(self) -> pd.DataFrame:
        """Return the raw times of a finished run: task, what was timed, nanoseconds."""
        return self._table("times.parquet", TIMES)

    def sentinel_samples(self) -> pd.DataFrame:
        """Return what the sentinel saw."""
        return self._table("sentinel.parquet", LOOKS)

    def _table(self, file: str, wanted: pa.Schema, name: Sequence[str] = ()) -> pd.DataFrame:
        path = self.path / file
        if not path.is_file():
            raise RunError(f"{self.path} has no {file}: the run was not finished, so resume it")
        try:
            return columns.read(path, wanted, name)
        except columns.TableError as error:
            raise RunError(f"{path}: {error}") from None


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open the file of a task; RunError where it is none."""
    try:
        with npz.opened(path) as data:
            yield data
    except ProblemFileError as error:
        raise RunError(f"{error}; remove the file and resume the run, and the task is done again") from None


def _rows(data: Mapping[str, Any]) -> list[Row]:
    """The rows of a task's file."""
    return unpacked(decoded(str(data["rows"]), list[Row]))
