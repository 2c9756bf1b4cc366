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
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Any

from bench.fleet.jobs import Job
from bench.fleet.storage import absolute, file_here, filesystem, folder_here, names_of
from bench.messages.task import Progress
from bench.processes.engine import MapUnordered
from piezo_model import atomic_file, json_file
from piezo_model.recordings import RecordingError

TABLES = ("fleet.csv", "fleet.parquet")
"""Files of the table of all recordings."""
Row = dict[str, Any]
"""``recording``, ``name`` and ``refused``, a sentence or ""; without a refusal, the figures of the job."""


@dataclass(frozen=True)
class Item:
    """The job on one recording."""

    job: Job
    recording: str
    name: str
    out: str

    @property
    def row(self) -> str:
        """Path of the row in the folder."""
        return f"rows/{self.name}.json"

    @property
    def product(self) -> str:
        """Path of the product in the folder; that of the row if the job makes no file."""
        return self.job.product.format(self.name) if self.job.product else self.row

    @contextmanager
    def inputs(self) -> Iterator[list[Path]]:
        """Local copies of the files that are read, the recording first."""
        with ExitStack() as stack:
            places = (self.recording, *self.job.reads(self.name))
            yield [stack.enter_context(file_here(place)) for place in places]

    def digest(self, inputs: Sequence[Path], product: Path) -> str:
        """SHA-256 of everything that determines the product, and of the product."""
        settings = [version("piezobench"), type(self.job).__name__, asdict(self.job)]  # type: ignore[call-overload]
        found = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
        for path in (*inputs, product) if self.job.product else inputs:
            with path.open("rb") as file:
                found.update(hashlib.file_digest(file, "sha256").digest())
        return found.hexdigest()


def run_all(items: Sequence[Item], map_unordered: MapUnordered, progress: Progress) -> list[Row]:
    """Process all items that are not finished; return the rows of all in the order of the items."""
    rows: dict[str, Row] = {}
    progress("starting", 0, len(items))
    for row in map_unordered(row_of, items):
        rows[row["name"]] = row
        progress(row["name"], len(rows), len(items))
    return [rows[item.name] for item in items]


def write_pages(items: Sequence[Item], map_unordered: MapUnordered, progress: Progress) -> Iterator[tuple[str, str]]:
    """Write the pages of finished recordings; yield the name of each and the path of its page."""
    for count, page in enumerate(map_unordered(write_page, items), 1):
        progress("drawing pages", count, len(items))
        yield page


def write_page(item: Item) -> tuple[str, str]:
    """Write the page of a finished recording; return its name and the path of the page, "" if the job has none."""
    from bench.report import recording_page  # plots take a second to import, and most workers draw none

    with item.inputs() as (recording, *further), file_here(f"{item.out}/{item.product}") as product:
        review = item.job.reviewed(recording, further, product)
        if review is None:
            return item.name, ""
        with folder_here(f"{item.out}/pages") as folder:
            recording_page.write(folder / f"{item.name}.html", recording.name, review)
    return item.name, f"pages/{item.name}.html"


def row_of(item: Item) -> Row:
    """The row of a recording, from disk if it is finished; any error becomes its refusal, so that the others go on."""
    row: Row = {"recording": item.recording, "name": item.name, "refused": ""}
    recording: Path | None = None
    try:
        with item.inputs() as inputs:
            recording, *further = inputs
            figures = _stored(item, inputs)
            if figures is None:
                with folder_here(item.out) as folder:
                    product = folder / item.product
                    figures = item.job.do(recording, further, product)
                    digest = item.digest(inputs, product)
                with folder_here(f"{item.out}/rows") as folder:
                    stored = json.dumps({"digest": digest, "figures": json_file.packed(figures)})
                    atomic_file.write_text(folder / f"{item.name}.json", f"{stored}\n")
        return {**row, **figures}
    except Exception as error:
        sentence = _sentence(error)
        return {**row, "refused": sentence.replace(str(recording), recording.name) if recording else sentence}


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    kind = "" if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: "
    return " ".join(f"{kind}{error}".split())


def _stored(item: Item, inputs: Sequence[Path]) -> Row | None:
    """The figures on disk, if the digest of inputs and product is still the same."""
    try:
        with file_here(f"{item.out}/{item.row}") as path:
            row = json_file.decoded(path.read_bytes(), dict[str, Any])
        with file_here(f"{item.out}/{item.product}") as product:
            return json_file.unpacked(row["figures"]) if row["digest"] == item.digest(inputs, product) else None
    except (OSError, ValueError, KeyError):  # absent, damaged, or of an earlier version
        return None


def products_of_others(job: Job, rows: Sequence[Row], out: str) -> list[str]:
    """Names of the files in the folder that look like products of the job, but were not made of these recordings."""
    fs, path = filesystem(out)
    pattern, own = job.product.format("*"), {job.product.format(row["name"]) for row in rows if not row["refused"]}
    files = [PurePosixPath(file) for file in fs.ls(path, detail=False)] if fs.isdir(path) else []
    return sorted({file.name for file in files if job.product and file.match(pattern)} - own)


def items_of(job: Job, recordings: Sequence[str], out: str) -> list[Item]:
    """One item for each recording, with absolute places, which do not depend on a worker's current folder.

    RecordingError if a recording would be replaced by a file of the fleet.
    """
    named = zip(recordings, names_of(recordings), strict=True)
    items = [Item(job, absolute(recording), name, absolute(out)) for recording, name in named]
    written = {filesystem(f"{absolute(out)}/{file}")[1] for file in (*TABLES, *(item.product for item in items))}
    for recording in recordings:
        if filesystem(recording)[1] in written:
            raise RecordingError(f"{recording}: would be replaced by a file of that name; name another --out-dir")
    return items
