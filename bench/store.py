"""The folder of a run; every finished task is saved in it before the next one starts.

    results/<run>/run.json        settings, seed, solvers and their versions
                  machines/       what made the rows: each machine with its versions and instruction set, JSON
                  problems/       the problems with their certificates, NPZ
                  models/         the models of raced recordings, JSON
                  parts/          during the race: an Arrow stream for each part (`part_file`)
                  rows.parquet    one row a task            } written at the end
                  times.parquet   raw nanoseconds           }
                  sentinel.parquet                          }
                  summary.csv, report.md

Each other file is written under a temporary name, flushed and renamed, so that an interruption at any moment leaves
only complete files and whole tasks. A run is finished by the removal of ``parts``, one rename.
"""

import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NotRequired, Self, TypedDict

import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from bench.messages import columns
from bench.messages.columns import named
from bench.part_file import STREAM, TIMES, PartFile, times_of
from bench.problem_files.program import ProblemFileError
from bench.problems.protocol import RaceProblem
from bench.race_table import KEY, ROWS
from bench.timing import machine
from piezo_model import json_file
from piezo_model.atomic_file import replacing, write_text
from piezo_model.checks import check, refusing
from piezo_model.json_file import FileName

VERSION = 7
"""Version of the run folder; raise it when the settings, the columns or their meaning change."""
SENTINEL = columns.schema(named("host", "core", "at_s", "ns", "level_ns", "ratio"))


class RunError(ValueError):
    """A run is missing or damaged; the message is one sentence."""


class Machine(TypedDict):
    """Description of the machine by `timing.machine.describe`."""

    processor: str
    cores: int | None
    system: str
    python: str
    core: str
    """Instruction set and compiler of our C core."""
    versions: dict[str, str]
    environment: NotRequired[dict[str, str]]
    load_at_start: list[float]
    warnings: list[str]


class Conditions(TypedDict):
    """Condition of the machine during the race."""

    sentinel_drift: float
    parts: list[dict[str, Any]]
    """Notes on its parts."""
    warnings: list[str]


class ModelNote(TypedDict):
    """As of ``ProblemSet.model`` and ``digests``, and what the recording says of creep; or the reason
    why there is no model."""

    error_percent: NotRequired[float]
    creep: NotRequired[str]
    refused: NotRequired[str]
    digests: dict[str, str]


class RunFile(TypedDict):
    """``run.json``."""

    settings: dict[str, Any]
    version: NotRequired[int]
    problems: NotRequired[dict[FileName, list[FileName]]]
    there_are: NotRequired[dict[str, int]]
    """Number of problems of each set that was raced in part."""
    left_out: NotRequired[dict[str, dict[str, str]]]
    models: NotRequired[dict[str, ModelNote]]
    lanes: NotRequired[dict[str, str]]
    """Version of each solver lane."""
    absent: NotRequired[dict[str, str]]
    own: NotRequired[dict[str, float]]
    """The largest error that each lane of a user's own file states."""
    conditions: NotRequired[Conditions]


@dataclass(frozen=True)
class Run:
    """One run's folder."""

    path: Path

    @classmethod
    def create(cls, results: Path, settings: Mapping[str, Any], name: str) -> Self:
        """Create the folder with its ``run.json``.

        It is created under a temporary name and renamed, so that every run with a name can be resumed.
        """
        check(
            name and name.isprintable() and Path(name).name == name and not name.startswith((".", "-")),
            f"the name of a run must be one line without a slash or a leading dot or dash, not {name!r}",
            RunError,
        )
        run = cls(results / name)
        check(not run.path.exists(), f"{run.path} already exists; give another name or resume it", RunError)
        results.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{name}.", dir=results) as temporary:
            new = Path(temporary, "run")
            for folder in ("problems", "parts"):
                (new / folder).mkdir(parents=True)
            write_text(new / "run.json", json.dumps({**settings, "version": VERSION}, indent=1) + "\n")
            new.rename(run.path)
        return run

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open an existing run of this version; one without a version is of version 1."""
        check((path / "run.json").is_file(), f"{path} is not a run folder: it has no run.json", RunError)
        for folder in filter(Path.is_symlink, path.iterdir()):
            check(
                not folder.is_dir(),
                f"{folder} is a link to another folder, and a run keeps its files in its own; replace it",
                RunError,
            )
        version = json_file.read(path / "run.json", dict[str, Any], RunError).get("version", 1)
        check(
            version == VERSION,
            f"{path / 'run.json'}: version {version!r:.60} is not {VERSION}, the one this program reads; race again",
            RunError,
        )
        return cls(path)

    def discard(self) -> None:
        """Remove the folder of a race that was refused, unless a task is done."""
        if (self.path / "parts").is_dir() and not any(part.rows for part in self.parts()):
            shutil.rmtree(self.path)

    @contextmanager
    def exclusive(self) -> Iterator[None]:
        """Lock the run against other processes; the lock ends with this process at the latest."""
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
        """Contents of ``run.json``."""
        return json_file.read(self.path / "run.json", RunFile, RunError)

    def note(self, **notes: Any) -> None:
        """Set fields of ``run.json``."""
        write_text(self.path / "run.json", json.dumps({**self.settings, **notes}, indent=1) + "\n")

    def note_of_set(self, problem_set: str, **notes: Any) -> None:
        """Set the entries of a problem set in fields of ``run.json``."""
        settings: Mapping[str, Any] = self.settings
        self.note(**{name: {**settings.get(name, {}), problem_set: value} for name, value in notes.items()})

    def problem_path(self, problem_set: str, problem: str) -> Path:
        """File of a problem."""
        return self.path / "problems" / f"{problem_set}--{problem}.npz"

    def model_path(self, problem_set: str) -> Path:
        """File of the model of a set's recording."""
        return self.path / "models" / f"{problem_set}.json"

    def problem(self, problem_set: str, name: str) -> RaceProblem:
        """Load a problem of the run; RunError if its file is missing or damaged."""
        path = self.problem_path(problem_set, name)
        check(
            path.is_file(),
            f"{path} is missing, or not accessible from {os.uname().nodename}, so the problem cannot be raced",
            RunError,
        )
        try:
            return RaceProblem.load(path)
        except ProblemFileError as error:
            raise RunError(f"{error}; remove the file and resume the run, and it is made again") from None

    def part(self, name: str) -> PartFile:
        """What is done of a part of the race; RunError if its file is damaged."""
        with refusing(RunError):
            return PartFile(self.path / "parts" / f"{name}.arrow")

    def parts(self) -> list[PartFile]:
        """All parts that were begun, during the race; an interrupted write leaves a hidden file."""
        return [self.part(path.stem) for path in sorted((self.path / "parts").glob("[!.]*.arrow"))]

    def rows_so_far(self) -> pd.DataFrame:
        """The rows of all finished tasks, during the race."""
        return (
            pa.concat_tables([part.table for part in self.parts()] or [STREAM.empty_table()])
            .select(ROWS.names)
            .to_pandas()
        )

    def note_machine(self) -> str:
        """Describe this machine in the run; returns what its rows have in the column ``machine``."""
        here = machine.describe()
        described = self.path / "machines" / f"{machine.key(here)}.json"
        if not described.exists():
            described.parent.mkdir(exist_ok=True)
            write_text(described, json.dumps(here, indent=1) + "\n")
        return described.stem

    def is_finished(self) -> bool:
        """Whether the tables are complete."""
        return (self.path / "rows.parquet").is_file() and not (self.path / "parts").exists()

    def finish(self) -> None:
        """Gather the parts into tables; their files are removed, all at once, when the tables are complete."""
        table = pa.concat_tables([part.table for part in self.parts()])
        rows = table.select(ROWS.names).sort_by([(name, "ascending") for name in KEY])
        for file, content in (("times.parquet", times_of(table)), ("rows.parquet", rows)):
            with replacing(self.path / file) as temporary:
                parquet.write_table(content, temporary)
        shutil.rmtree((self.path / "parts").rename(self.path / ".parts"))

    @property
    def machines(self) -> dict[str, Machine]:
        """The machines that made rows, with their versions and instruction sets, by the column ``machine``."""
        folder = self.path / "machines"
        machines = {path: json_file.read(path, Machine, RunError) for path in sorted(folder.glob("[!.]*.json"))}
        for path, host in machines.items():
            check(
                machine.key(host) == path.stem,
                f"{path}: does not match the digest in its name; restore it, or race again",
                RunError,
            )
        check(machines, f"{folder} describes no machine of this run", RunError)
        return {path.stem: host for path, host in machines.items()}

    def check_machines(self, rows: pd.DataFrame, file: str) -> None:
        """RunError unless each machine that made the rows is described."""
        for unknown in sorted(set(rows.machine).difference(self.machines)):
            raise RunError(
                f"{self.path / file}: column 'machine' has {unknown!r}, and {self.path / 'machines'} has "
                f"no {unknown}.json; restore it, or race again"
            )

    @property
    def machine_names(self) -> list[str]:
        """Names of the machines that made rows, without their versions."""
        return sorted({machine.name(host) for host in self.machines.values()})

    def machine_of(self, rows: pd.DataFrame) -> Machine:
        """The machine that made most of these rows."""
        machines = self.machines
        known = rows.machine[rows.machine.isin(machines)]
        return machines[known.mode().iloc[0]] if len(known) else next(iter(machines.values()))

    def rows(self) -> pd.DataFrame:
        """The table of a finished run, each row with a machine that the run describes."""
        table = self._table("rows.parquet", ROWS, ("task", *KEY))
        self.check_machines(table, "rows.parquet")
        return table

    def times(self) -> pd.DataFrame:
        """The raw times of a finished run."""
        return self._table("times.parquet", TIMES)

    def sentinel_samples(self) -> pd.DataFrame:
        """The sentinel's samples in a finished run."""
        return self._table("sentinel.parquet", SENTINEL)

    def _table(self, file: str, schema: pa.Schema, key: Sequence[str] = ()) -> pd.DataFrame:
        path = self.path / file
        check(path.is_file(), f"{self.path} has no {file}: the run was not finished, so resume it", RunError)
        with refusing(RunError, f"{path}: "):
            return columns.read(path, schema, key)
