"""Apache Parquet, and the stream of Arrow batches that an interrupted ``piezobench live`` leaves behind, up to its last
complete batch; both are read by Arrow, a batch of rows at a time."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow.parquet import ParquetFile

from piezo_model.recordings.table import Column, Kind, RecordingError, Table

BATCH_ROWS = 1 << 18
BUFFER_BYTES = 1 << 18


def open_parquet(path: Path) -> list[Table]:
    """A Parquet file."""
    with ParquetFile(path) as file:
        schema, rows = file.schema_arrow, file.metadata.num_rows

    def batches(names: list[str] | None) -> Iterator[pa.RecordBatch]:
        # buffered and not prefetched: otherwise a row group, which may be the whole file, is held in memory
        with ParquetFile(path, buffer_size=BUFFER_BYTES, pre_buffer=False) as file:
            yield from file.iter_batches(BATCH_ROWS, columns=names)

    return _table(path, "Parquet", schema, batches, rows)


def open_stream(path: Path) -> list[Table]:
    """A stream of Arrow batches."""
    with pa.OSFile(str(path)) as source:
        schema = pa.ipc.open_stream(source).schema
    return _table(path, "Arrow stream", schema, lambda names: whole_batches(path))


def whole_batches(path: Path) -> Iterator[pa.RecordBatch]:
    """The batches of a stream in order, up to a truncated one."""
    with pa.OSFile(str(path)) as source, suppress(pa.ArrowException, OSError):
        yield from pa.ipc.open_stream(source)


def _table(
    path: Path,
    form: str,
    schema: pa.Schema,
    batches_of: Callable[[list[str] | None], Iterable[pa.RecordBatch]],
    rows: int | None = None,
) -> list[Table]:
    columns = tuple(Column.named(field.name, kind=_kind(field.type), rows=rows) for field in schema)

    def batches(at: Sequence[int]) -> Iterator[list[np.ndarray]]:
        for k in at:
            if columns[k].kind not in ("number", "clock"):
                raise RecordingError(
                    f"{path}: column {columns[k].name!r} holds values of type {schema.types[k]} from data row 1 on, "
                    "where numbers are needed"
                )
        names = list(dict.fromkeys(schema.names[k] for k in at)) if len(set(schema.names)) == len(schema) else None
        for batch in batches_of(names):
            yield [array_of(batch.column(schema.names[k] if names else k)) for k in at]

    return [Table(path, form, columns, batches)]


def _kind(type: pa.DataType) -> Kind:
    if pa.types.is_floating(type) or pa.types.is_integer(type) or pa.types.is_decimal(type):
        return "number"
    return "clock" if pa.types.is_temporal(type) and not pa.types.is_date(type) else "text"


def array_of(column: pa.Array) -> np.ndarray:
    """Numbers, with NaN where one is missing; datetime64 or timedelta64 with NaT."""
    if not pa.types.is_temporal(column.type):
        if column.null_count or pa.types.is_decimal(column.type):
            # of a decimal only the text is rounded correctly
            written = column.cast(pa.string()) if pa.types.is_decimal(column.type) else column
            column = written.cast(pa.float64(), safe=False).fill_null(math.nan)
        return np.asarray(np.from_dlpack(column))  # to_numpy would import pandas
    whole = column.cast(pa.int32() if column.type.bit_width == 32 else pa.int64()).cast(pa.int64())
    kind = "M" if pa.types.is_timestamp(column.type) else "m"
    return np.from_dlpack(whole.fill_null(np.iinfo(np.int64).min)).view(f"{kind}8[{column.type.unit}]")
