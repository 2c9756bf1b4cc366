"""The same job on every recording of a fleet. A finished recording has a row on disk and is not processed again.

    OUT/NAME.json           product of the job, such as the recording's model
    OUT/rows/NAME.json      figures of the row, with a SHA-256 of the program's version, the job's settings, the files
                            that were read and the product

The row is written last and each file is replaced whole, so an interruption costs only the recordings in progress. A
recording is processed again if the digest differs, and if it was refused. Nothing is ever deleted: products of earlier
runs, of recordings that are refused now or were not given, stay in the folder, and the report names them.
"""

import hashlib
import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from bench.fleet.jobs import Job
from bench.messages.task import Progress
from bench.processes.engine import MapUnordered
from bench.report import words
from piezo_model import atomic_file, json_file
from piezo_model.checks import check
from piezo_model.recordings import RecordingError

TABLE = "fleet.csv"
"""File of the table of all recordings."""
NAMED = 4
"""Most files that a sentence names."""
Row = dict[str, Any]
"""``recording``, ``name`` and ``refused``, a sentence or ""; without a refusal, the figures of the job."""


@dataclass(frozen=True)
class Item:
    """The job on one recording."""

    job: Job
    recording: Path
    name: str
    out: Path

    @property
    def row(self) -> Path:
        """Path of the row."""
        return self.out / "rows" / f"{self.name}.json"

    @property
    def product(self) -> Path:
        """Path of the product; that of the row if the job makes no file."""
        return self.out / self.job.product.format(self.name) if self.job.product else self.row

    def digest(self) -> str:
        """SHA-256 of everything that determines the product, and of the product."""
        settings = [version("piezobench"), type(self.job).__name__, asdict(self.job)]  # type: ignore[call-overload]
        hasher = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
        inputs = (self.recording, *self.job.reads(self.name))
        for path in (*inputs, self.product) if self.job.product else inputs:
            with path.open("rb") as file:
                hasher.update(hashlib.file_digest(file, "sha256").digest())
        return hasher.hexdigest()


def run_all(items: Sequence[Item], map_unordered: MapUnordered, progress: Progress) -> list[Row]:
    """Process all items that are not finished; return the rows of all in the order of the items."""
    rows: dict[str, Row] = {}
    progress("starting", 0, len(items))
    for row in map_unordered(row_of, items):
        rows[row["name"]] = row
        progress(row["name"], len(rows), len(items))
    return [rows[item.name] for item in items]


def row_of(item: Item) -> Row:
    """The row of a recording, from disk if it is finished; any error becomes its refusal, so that the others go on."""
    row: Row = {"recording": str(item.recording), "name": item.name, "refused": ""}
    try:
        figures = _stored(item)
        if figures is None:
            item.row.parent.mkdir(parents=True, exist_ok=True)
            figures = item.job.do(item.recording, item.job.reads(item.name), item.product)
            stored = json.dumps({"digest": item.digest(), "figures": json_file.packed(figures)})
            atomic_file.write_text(item.row, f"{stored}\n")
        return {**row, **figures}
    except Exception as error:
        return {**row, "refused": _sentence(error).replace(str(item.recording), item.recording.name)}


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    kind = "" if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: "
    return " ".join(f"{kind}{error}".split())


def _stored(item: Item) -> Row | None:
    """The figures on disk, if the digest of inputs and product is still the same."""
    try:
        row = json_file.decoded(item.row.read_bytes(), dict[str, Any])
        return json_file.unpacked(row["figures"]) if row["digest"] == item.digest() else None
    except (OSError, ValueError, KeyError):  # absent, damaged, or of an earlier version
        return None


def products_of_others(job: Job, rows: Sequence[Row], out: Path) -> list[str]:
    """Names of the files in the folder that look like products of the job, but were not made of these recordings."""
    own = {job.product.format(row["name"]) for row in rows if not row["refused"]}
    return sorted({path.name for path in out.glob(job.product.format("*"))} - own) if job.product else []


def local(place: str) -> Path:
    """Absolute path, which does not depend on a worker's current folder; RecordingError for a URL."""
    check("://" not in place, f"{place}: is a URL; give a local path", RecordingError)
    return Path(os.path.abspath(place))


def names_of(recordings: Sequence[str]) -> list[str]:
    """Unique names for the products of files: their own without suffix, after as many parent folders as needed.

    Examples
    --------
    >>> names_of(["a/left.csv", "a/right.csv"]), names_of(["1/stage.csv", "2/stage.csv"])
    (['left', 'right'], ['1--stage', '2--stage'])
    """
    paths = [local(recording).with_suffix("").parts[1:] for recording in recordings]
    for depth in range(1, max(map(len, paths)) + 1):
        names = ["--".join(path[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    twice = next(i for i, path in enumerate(paths) if path in paths[:i])
    raise RecordingError(
        f"{recordings[twice]}: its result would have the name of that of {recordings[paths.index(paths[twice])]}"
    )


def items_of(job: Job, recordings: Sequence[str], out: Path) -> list[Item]:
    """One item for each recording, with absolute paths.

    RecordingError if a recording would be replaced by a file of the fleet.
    """
    items = [Item(job, local(place), name, out) for place, name in zip(recordings, names_of(recordings), strict=True)]
    written = {out / TABLE, *(item.product for item in items)}
    for place in recordings:
        check(local(place) not in written, f"{place}: would be overwritten; name another --out-dir", RecordingError)
    return items


def write_table(out: Path, rows: Sequence[Row]) -> pd.DataFrame:
    """Write and return the table, those of refused recordings first, then by decreasing error."""
    by_error = sorted(rows, key=lambda row: -row.get("rms_percent", math.inf))
    table = pd.DataFrame(by_error)
    with atomic_file.replacing(out / TABLE) as temporary:
        table.to_csv(temporary, index=False)
    return table


def sentences(table: pd.DataFrame, what: str, others: Sequence[str] = ()) -> list[str]:
    """Number of recordings, distribution of the errors, and files that are not of this run."""
    fine = table[table.refused == ""]
    lines = [f"{len(fine)} of {len(table)} recordings {what}."]
    if len(fine):
        low, middle, high = fine.rms_percent.quantile([0.05, 0.5, 0.95])
        lines.append(
            f"RMS error of the output, as a share of its range: {middle:.2g} % in the median, {low:.2g} % to "
            f"{high:.2g} % in nine of ten."
        )
    if own := int(fine.get("own", pd.Series(dtype=bool)).sum()):
        lines.append(f"Judged on the recording that the model was fitted to, which says little about others: {own}.")
    if others:
        named = words.joined([*others[:NAMED], f"{len(others) - NAMED} more"] if len(others) > NAMED else others)
        lines.append(f"Not of this run, but in the folder: {named}.")
    return lines
