"""JSON files: what each holds is a type, and what does not fit it is one sentence with the file and the field.

A schema is a dataclass, a ``TypedDict`` or a ``msgspec.Struct`` whose annotations may carry ranges. Numbers beyond
those of doubles, fields that a schema does not have, bytes that are no UTF-8 and nesting without end are refused like
wrong types. A file that has to say what it is begins with two more fields, ``{"format": …, "version": …}``. Where a
file holds arrays, each of them is ``{"dtype": …, "shape": […], "base64": …}``, and numbers that JSON lacks are
``{"float": "nan"}`` and the like.
"""

import base64
import math
import re
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_origin

import msgspec
import numpy as np

T = TypeVar("T")

LARGEST = 1e100
"""Of any number of a model: far above all quantities, and far enough below the largest double for sums of squares."""
Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
FileName = Annotated[str, msgspec.Meta(min_length=1, max_length=200, pattern=r"^[^/\x00-\x1f]+$")]


class Versioned(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A file that says what it is."""

    FORMAT: ClassVar[str]
    VERSION: ClassVar[int]
    AGAIN: ClassVar[str] = ""
    """What to do about a file of another version."""
    format: str
    version: int


def read(path: str | Path, schema: type[T], refused: type[ValueError] = ValueError) -> T:
    """What a file holds; the error names it, and says in one sentence why it cannot be read or what in it does not
    fit."""
    try:
        return decoded(Path(path).read_bytes(), schema)
    except FileNotFoundError:
        raise refused(f"{path}: there is no such file") from None
    except OSError as error:
        raise refused(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise refused(f"{path}: {brief(error)}") from None


def brief(error: Exception) -> str:
    """What an error says, without all that a hostile file may have put into it."""
    return textwrap.shorten(str(error), 500, placeholder=" …") if len(str(error)) > 500 else str(error)


def decoded(text: str | bytes, schema: type[T]) -> T:
    """What a JSON text holds; ValueError says what does not fit."""
    try:
        try:
            found = msgspec.json.decode(text)
        except msgspec.ValidationError:
            msgspec.json.decode(text, type=schema)  # which says what field it is in
            raise
    except msgspec.ValidationError as error:
        raise ValueError(_sentence(error)) from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"is not a whole JSON file ({error})") from None
    return convert(found, schema)


def convert(data: Any, schema: type[T]) -> T:
    """What decoded JSON holds; ValueError says what does not fit.

    Examples
    --------
    >>> convert({"x": [1, 2]}, dict[str, list[float]])
    {'x': [1.0, 2.0]}
    >>> convert({"x": [1, "2"]}, dict[str, list[float]])
    Traceback (most recent call last):
    ValueError: the field '[...][1]' is wrong: expected `float`, got `str`
    """
    kind = get_origin(schema) or schema
    if isinstance(kind, type) and issubclass(kind, Versioned):
        _check_version(data, kind)
    try:
        found = msgspec.convert(data, schema)
        unknown = _unknown(data, msgspec.to_builtins(found, enc_hook=lambda _: None))
    except msgspec.ValidationError as error:
        raise ValueError(_sentence(error)) from None
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    if unknown:
        raise ValueError(f"there is no field {unknown!r}")
    return found


class PackedArray(msgspec.Struct):
    """An array, little-endian."""

    dtype: Annotated[str, msgspec.Meta(pattern=r"^[<|][biuf][1248]$")]
    shape: list[Annotated[int, msgspec.Meta(ge=0)]]
    base64: bytes


def packed(value: Any) -> Any:
    """Return a value as JSON can hold it.

    Examples
    --------
    >>> unpacked(packed({"a": np.arange(2.0), "b": (1, math.inf)}))
    {'a': array([0., 1.]), 'b': [1, inf]}
    """
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return {
            "dtype": data.dtype.str,
            "shape": list(data.shape),
            "base64": base64.b64encode(data.tobytes()).decode("ascii"),
        }
    if isinstance(value, Mapping):
        return {str(name): packed(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [packed(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": str(value)}
    return value


def unpacked(value: Any) -> Any:
    """Undo :func:`packed`, and lists stay lists; ValueError for what is not an array."""
    if isinstance(value, list):
        return [unpacked(item) for item in value]
    if not isinstance(value, dict):
        return value
    if set(value) == {"float"}:
        return float(convert(value["float"], Literal["nan", "inf", "-inf"]))  # type: ignore[arg-type]
    if set(value) == {"dtype", "shape", "base64"}:
        part = convert(value, PackedArray)
        array = np.frombuffer(part.base64, dtype=np.dtype(part.dtype)).reshape(part.shape)
        return array.astype(array.dtype.newbyteorder("="))
    return {name: unpacked(item) for name, item in value.items()}


def format_of(path: str | Path) -> str:
    """The format that a file says it has, or nothing; whoever reads the whole of it says what is wrong with it."""
    try:
        found: Any = read(path, dict[str, Any]).get("format")
    except ValueError:
        return ""
    return found if isinstance(found, str) else ""


def _check_version(data: Any, schema: type[Versioned]) -> None:
    if not isinstance(data, dict) or data.get("format") != schema.FORMAT:
        raise ValueError(f"the format field is not {schema.FORMAT!r}")
    version = data.get("version")
    if version != schema.VERSION:
        raise ValueError(
            f"version {str(version)[:20]} is not {schema.VERSION}, the one this program "
            f"reads{schema.AGAIN and f'; {schema.AGAIN}'}"
        )


def _unknown(data: Any, known: Any) -> str:
    """Path of the first field that is in the data and not in what was made of them."""
    if isinstance(data, dict) and isinstance(known, dict):
        for name, value in data.items():
            if name not in known:
                return str(name)
            if below := _unknown(value, known[name]):
                return f"{name}.{below}"
    return ""


def _sentence(error: msgspec.ValidationError) -> str:
    """The words of msgspec, "Expected `float`, got `str` - at `$.x[1]`", as one sentence with the field."""
    what, _, where = str(error).partition(" - at `$")
    where = where.rstrip("`").lstrip(".")
    if named := re.fullmatch("Object missing required field `(.*)`", what):
        return f"the field {'.'.join(filter(None, (where, named[1])))!r} is missing"
    if named := re.fullmatch("Object contains unknown field `(.*)`", what):
        return f"there is no field {'.'.join(filter(None, (where, named[1])))!r}"
    if isinstance(error.__cause__, ValueError):  # a sentence of our own
        return f"{where}: {what}" if where else what
    return f"the field {where!r} is wrong: {what[0].lower()}{what[1:]}" if where else what[0].lower() + what[1:]
