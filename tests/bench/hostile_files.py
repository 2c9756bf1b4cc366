"""Invalid files: arbitrary content, valid documents and tables with one change each, and runs whose texts are code."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from programs import ALL
from pyarrow import parquet

from bench.messages.columns import CHOICES, PATTERNS
from bench.store import Run
from bench.timing import machine
from piezo_model import HysteresisCreepModel, ModelStructure

STRUCTURE = ModelStructure.equidistant(
    n=3, m=1, x_range=(0.0, 10.0), y_range=(0.0, 5.0), creep_rates=(1.0,), sample_time=1e-3
)
MODEL = replace(
    HysteresisCreepModel.from_weights(STRUCTURE, STRUCTURE.straight_line), report={"headline": "fits", "findings": []}
)
DEEP = "[" * 100_000 + "]" * 100_000
LONG = "1" + "0" * 5000
TOKENS = (
    "null",
    "true",
    "-1",
    "1.5",
    "0",
    "1e400",
    "-1e400",
    "1e308",
    "-1e308",
    "1e-308",
    "NaN",
    "Infinity",
    LONG,
    "1" * 400,
    DEEP,
    '"text"',
    '""',
    "[]",
    "{}",
    "[[]]",
    '[{"a": [1]}]',
    '"\\ud800"',
    '"\\u001b[2J[red]x[/blue] */ <b>"',
    '"../../x"',
    f'"{"x" * 10_000}"',
)
"""JSON values that replace a field."""
WHOLE = {
    "nothing": b"",
    "no JSON": b"time_s,y_um\n0,1\n",
    "Latin-1": '{"a": "µ"}'.encode("latin-1"),
    "no UTF-8": b"\xff\xfe\x00",
    "UTF-16": '{"format": "x"}'.encode("utf-16"),
    "half": b'{"format": "piezobench-model", "ver',
    "null": b"null",
    "a list": b"[]",
    "a number": b"1",
    "deep": DEEP.encode(),
    "deep and open": b"[" * 100_000,
    "deep objects": b'{"a":' * 100_000,
    "digits": LONG.encode(),
    "zeros": bytes(1000),
    "another format": b'{"format": "GeoJSON", "version": 1}',
}
"""Contents that are no document of ours, by description."""


def places(document: Any, at: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of all fields of a document; of lists, and of tables with a name in each row, only of the first element."""
    if at:
        yield at
    inside: Any = (
        document.items()
        if isinstance(document, dict)
        else list(enumerate(document))[:1]
        if isinstance(document, list)
        else ()
    )
    # A JSON object of more than 20 fields is no record but a table with a name in each row.
    for name, value in list(inside)[: 1 if len(inside) > 20 else None]:
        yield from places(value, (*at, name))


def spoiled(document: Any, at: tuple[str | int, ...], *tokens: str) -> list[bytes]:
    """The document as JSON, with the field at a path replaced by each token."""
    copy = json.loads(json.dumps(document))
    inner = copy
    for name in at[:-1]:
        inner = inner[name]
    inner[at[-1]] = "@HERE@"
    before, after = json.dumps(copy).split('"@HERE@"')
    return [f"{before}{token}{after}".encode() for token in tokens]


def thinned(cases: Sequence, number: int) -> Sequence:
    """All cases with ALL=1, else an eighth of them; the next number has another eighth."""
    return cases if ALL else cases[number % 8 :: 8]


def spoiled_documents(document: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """The contents in WHOLE, and the document with each field missing or replaced by tokens, with a description."""
    yield from WHOLE.items()
    text = json.dumps(document)
    for name in document:
        yield (
            f"without {name}",
            json.dumps({other: value for other, value in document.items() if other != name}).encode(),
        )
    yield "another field", (text[:-1] + ', "colour": "red"}').encode()
    for number, at in enumerate(places(document)):
        tokens = thinned(TOKENS, number)
        yield from zip((f"{at} = {token[:20]}" for token in tokens), spoiled(document, at, *tokens), strict=True)


def spoiled_tables(table: pa.Table) -> Iterator[tuple[str, pa.Table]]:
    """The table without rows, with repeated rows, and with a column missing or of other types, with a description."""
    yield "no rows", table.slice(0, 0)
    yield "rows twice", pa.concat_tables([table, table])
    n = table.num_rows
    others = {
        "text": pa.array(["x"] * n),
        "whole numbers": pa.array([-7] * n),
        "doubles": pa.array([np.inf] * n),
        "nothing": pa.nulls(n),
        "flags": pa.array([True] * n),
        "lists": pa.array([[1, 2]] * n),
        "lists of text": pa.array([["a"]] * n),
        "bytes": pa.array([b"\xff"] * n),
        "times": pa.array([0] * n, pa.timestamp("ns")),
        "markup": pa.array(["[/red]\x1b[2J|<b>\n"] * n),
        "negative": pa.array([-1e308] * n),
    }
    for i, name in enumerate(table.column_names):
        yield f"without {name}", table.drop_columns([name])
        for what, values in thinned([*others.items()], i):
            yield f"{name} of {what}", table.set_column(i, name, values)


PYTHON = "' + @pd.io.common.os.system('touch HARMED') + '"
"""Runs a command where it stands between quotes in a filter that pandas evaluates."""
SCRIPT = (
    "'] || (document.title = 'harmed') || ['\"}</script><script>document.title = 'harmed'</script>"
    "<img src=x onerror=document.title='harmed'>"
)
"""Runs JavaScript where it stands between quotes in an expression of Vega, or as markup."""
FORMAT = "{0.__class__.__mro__}{{ 7 * 7 }}%s${HOME}$(touch HARMED)`touch HARMED`"
PAYLOADS = (PYTHON, SCRIPT, FORMAT)


NEEDED = ("status", "settings", "machine", "problem_set")
"""Columns without whose texts a run is refused; with the last, names of files would be too long."""


def hostile_texts(schema: pa.Schema, together: bool) -> list[tuple[list[str], Sequence[str]]]:
    """Columns of texts and payloads for them: all columns but needed ones, with each payload, if ``together``; else
    each column alone, with all payloads in turn."""
    texts = [each.name for each in schema if pa.types.is_large_string(each.type) and each.name not in CHOICES]
    if together:
        return [([name for name in texts if name not in NEEDED], (payload,)) for payload in PAYLOADS]
    return [([name], PAYLOADS) for name in texts]


def change_machine(folder: Path, **changes: object) -> None:
    """Make the rows of a run those of another machine."""
    (path,) = (folder / "machines").iterdir()
    described = json.loads(path.read_text()) | changes
    path.unlink()
    key = machine.key(described)
    path.with_name(f"{key}.json").write_text(json.dumps(described))
    for file in folder.glob("*.parquet"):
        table = parquet.read_table(file)
        if "machine" in table.column_names:
            at = table.column_names.index("machine")
            parquet.write_table(table.set_column(at, "machine", pa.array([key] * table.num_rows)), file)


def make_hostile(run: Run, file: str, columns: Iterable[str], payloads: Sequence[str]) -> None:
    """Append the payloads in turn to the texts of these columns, and put them into the descriptions of machine and
    field."""
    change_machine(run.path, processor=payloads[0], core=payloads[-1], warnings=[*payloads])
    table = parquet.read_table(run.path / file)
    for name in columns:
        texts = [
            json.dumps({**json.loads(text), payload: payload})
            if name in ("setting", "settings")
            else text + (payload.replace("/", "") if name in PATTERNS else payload)
            for text, payload in zip(table[name].to_pylist(), cycle(payloads), strict=False)
        ]
        table = table.set_column(table.column_names.index(name), name, pa.array(texts))
    parquet.write_table(table, run.path / file)
    named = {payload: payload for payload in payloads}
    run.note(lanes=named, absent=named, left_out={"paper": {name.replace("/", ""): name for name in payloads}})
