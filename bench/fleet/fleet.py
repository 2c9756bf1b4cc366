"""The same work on every recording of a fleet: each has a row on disk once it is done, and is not done again.

    OUT/NAME.json           what the work makes of a recording, such as its model
    OUT/rows/NAME.json      its row, with a digest of this program's version, the work's settings and the content of
                            what it read, and one of what was made

The row comes last and goes first, each file is written whole, and the digests decide: so an interruption at any moment
costs the recordings that were under way, and other settings or another content, read or made, are done again. So is
what was refused.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypedDict

from bench.fleet.storage import absolute, file_here, filesystem, folder_here, names_of
from bench.fleet.works import Work
from bench.messages.progress import Progress
from bench.processes.engine import Workers, parallel_map
from piezo_model.atomic_file import write_text
from piezo_model.json_file import decoded, packed, unpacked

Row = dict[str, Any]
"""``recording``, ``name`` and ``refused``, the sentence that says why there is no more, or ""; then figures of the
work."""


class Kept(TypedDict):
    """A row on disk: SHA-256 of all that decides what is made, and of what was made beside the row."""

    digest: str
    made: str
    figures: dict[str, Any]


@dataclass(frozen=True)
class Part:
    """The work on one recording."""

    work: Work
    recording: str
    name: str
    out: str


def done(parts: Sequence[Part], workers: Workers, progress: Progress) -> list[Row]:
    """Do all parts, or find them done; returns their rows in the order of the parts."""
    found: dict[str, Row] = {}
    progress("starting", 0, len(parts))
    for row in parallel_map(row_of, parts, workers):
        found[row["name"]] = row
        progress(row["name"], len(found), len(parts))
    return [found[part.name] for part in parts]


def drawn(parts: Sequence[Part], workers: Workers, progress: Progress) -> Iterator[tuple[str, str]]:
    """Draw the pages of recordings whose work is done; yields their names and places."""
    for at, page in enumerate(parallel_map(draw, parts, workers)):
        progress("drawing pages", at + 1, len(parts))
        yield page


def draw(part: Part) -> tuple[str, str]:
    """Write the page of a recording whose work is done; returns its name and place in the folder, "" where the work
    has none."""
    from bench.report import recording_page  # plots take a second to import, and most workers draw none

    with ExitStack() as stack:
        recording, made, *further = (
            stack.enter_context(file_here(place))
            for place in (
                part.recording,
                f"{part.out}/{part.work.made or 'rows/{}.json'}".format(part.name),
                *part.work.reads(part.name),
            )
        )
        found = part.work.reviewed(recording, further, made)
        if found is None:
            return part.name, ""
        folder = stack.enter_context(folder_here(f"{part.out}/pages"))
        recording_page.write(folder / f"{part.name}.html", recording.name, found)
    return part.name, f"pages/{part.name}.html"


def row_of(part: Part) -> Row:
    """The row of a recording, done now or before; whatever goes wrong is said in it, since the others are to have
    theirs."""
    row, kept = {"recording": part.recording, "name": part.name, "refused": ""}, f"{part.name}.json"
    here: Path | None = None
    try:
        with ExitStack() as stack:
            here, *further = (
                stack.enter_context(file_here(place)) for place in (part.recording, *part.work.reads(part.name))
            )
            digest = _digest(part.work, (here, *further))
            if (before := _kept(part, digest)) is not None:
                return {**row, **before}
            _forget(part.out, f"rows/{kept}")
            with folder_here(part.out) as folder:
                target = folder / (part.work.made or ".").format(part.name)
                figures = part.work.do(here, further, target)
                made = hashlib.sha256(target.read_bytes() if part.work.made else b"").hexdigest()
            with folder_here(f"{part.out}/rows") as folder:
                write_text(folder / kept, json.dumps(Kept(digest=digest, made=made, figures=packed(figures))) + "\n")
        return {**row, **figures}
    except Exception as error:
        _forget(part.out, f"rows/{kept}", part.work.made.format(part.name))
        said = _sentence(error)
        return {**row, "refused": said if here is None else said.replace(str(here), here.name)}


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    kind = "" if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: "
    return " ".join(f"{kind}{error}".split())


def _digest(work: Work, files: Sequence[Path]) -> str:
    settings = asdict(work)  # type: ignore[call-overload]
    found = hashlib.sha256(json.dumps([version("piezobench"), type(work).__name__, settings], sort_keys=True).encode())
    for path in files:
        with path.open("rb") as file:
            found.update(hashlib.file_digest(file, "sha256").digest())
    return found.hexdigest()


def _kept(part: Part, digest: str) -> Row | None:
    """The figures of a row on disk with this digest whose work is there as it was made; None where it is to be done."""
    fs, out = filesystem(part.out)
    try:
        found = decoded(fs.cat_file(f"{out}/rows/{part.name}.json"), Kept)
        made = fs.cat_file(f"{out}/{part.work.made.format(part.name)}") if part.work.made else b""
        figures: Row = unpacked(found["figures"])
    except (OSError, ValueError):  # not there, of an older program, or damaged
        return None
    return figures if (found["digest"], found["made"]) == (digest, hashlib.sha256(made).hexdigest()) else None


def _forget(out: str, *files: str) -> None:
    fs, path = filesystem(out)
    for file in filter(None, files):
        if fs.isfile(f"{path}/{file}"):
            fs.rm_file(f"{path}/{file}")


def parts_of(work: Work, recordings: Sequence[str], out: str) -> Iterator[Part]:
    """One part a recording, with places that are the same from every worker's folder."""
    for recording, name in zip(recordings, names_of(recordings), strict=True):
        yield Part(work, absolute(recording), name, absolute(out))
