"""JSON files with schemas; any violation gives one sentence that names the file and the field.

A schema is a dataclass, a ``TypedDict`` or a ``msgspec.Struct`` whose annotations may have ranges. Numbers that are no
doubles, unknown fields, invalid UTF-8 and excessive nesting are refused like wrong types. A versioned file also has the
fields ``{"format": …, "version": …}``. An array is stored as ``{"dtype": …, "shape": […], "base64": …}``, and numbers
that JSON lacks as ``{"float": "nan"}`` and the like.
"""

import base64
import json
import math
import re
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NoReturn, TypeVar, get_origin

import msgspec
import numpy as np

from piezo_model.atomic_file import write_text

T = TypeVar("T")

LARGEST = 1e100
"""Largest number in a model: far above all physical values, and small enough for sums of squares in doubles."""
Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
FileName = Annotated[str, msgspec.Meta(pattern=r"^[^/\x00-\x1f]{1,200}$")]


class Versioned(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A file with a format and a version."""

    FORMAT: ClassVar[str]
    VERSION: ClassVar[int]
    UPGRADE_HINT: ClassVar[str] = ""
    """Advice for a file of another version."""
    format: str
    version: int

    def __post_init__(self) -> None:
        check_version({"format": self.format, "version": self.version}, type(self))  # of one inside another file, too


def read(path: str | Path, schema: type[T], refused: type[ValueError] = ValueError) -> T:
    """The content of a file; the error is a sentence that names the file, and the reason or the wrong field."""
    try:
        return decoded(Path(path).read_bytes(), schema)
    except FileNotFoundError:
        raise refused(f"{path}: no such file") from None
    except OSError as error:
        raise refused(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise refused(f"{path}: {brief(error)}") from None


def write(path: str | Path, content: Mapping[str, Any], refused: type[ValueError]) -> None:
    """Replace a file as a whole; the error is a sentence that names the file, and the reason or the wrong field."""
    try:
        write_text(path, json.dumps(packed(content), indent=1) + "\n")
    except (OSError, ValueError) as error:
        raise refused(f"{path}: cannot be written: {getattr(error, 'strerror', '') or brief(error)}") from None


def brief(error: Exception) -> str:
    """An error's message, shortened: it may quote a hostile file."""
    return textwrap.shorten(str(error), 500, placeholder=" …") if len(str(error)) > 500 else str(error)


def decoded(text: str | bytes, schema: type[T]) -> T:
    """The content of a JSON text; ValueError names a wrong field."""
    try:
        try:
            data = msgspec.json.decode(text)
        except msgspec.ValidationError:
            msgspec.json.decode(text, type=schema)  # whose error names the field
            raise
    except msgspec.ValidationError as error:
        raise ValueError(_sentence(error)) from None
    except (ValueError, RecursionError) as error:
        raise ValueError(f"is not a whole JSON file ({error})") from None
    return convert(data, schema)


def convert(data: Any, schema: type[T]) -> T:
    """The content of decoded JSON; ValueError names a wrong field.

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
        check_version(data, kind)  # before its fields, which may be others
    try:
        result = msgspec.convert(data, schema)
        unknown = _unknown(data, msgspec.to_builtins(result, enc_hook=lambda _: None))
    except msgspec.ValidationError as error:
        raise ValueError(_sentence(error)) from None
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    except AttributeError:  # msgspec takes an array for a mapping, and fails on its items
        raise ValueError("has an array where fields are needed") from None
    if unknown:
        raise ValueError(f"there is no field {unknown!r}")
    return result


class ReadOnly(dict[str, Any]):
    """JSON types that cannot be changed."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__(
            (name, ReadOnly(item) if isinstance(item, Mapping) else tuple(item) if isinstance(item, list) else item)
            for name, item in values.items()
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return ReadOnly, (dict(self),)

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError("it is read-only; change a copy, dict(…), and pass that to dataclasses.replace")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse  # type: ignore[assignment]


class PackedArray(msgspec.Struct):
    """An array, little-endian."""

    dtype: Annotated[str, msgspec.Meta(pattern=r"^[<|][biuf][1248]$")]
    shape: list[Annotated[int, msgspec.Meta(ge=0)]]
    base64: bytes


def packed(value: Any, name: str = "") -> Any:
    """Return a value that JSON can store; ValueError names a field that it cannot.

    Examples
    --------
    >>> unpacked(packed({"a": np.arange(2.0), "b": (1, math.inf)}))
    {'a': array([0., 1.]), 'b': [1, inf]}
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        data = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return {
            "dtype": data.dtype.str,
            "shape": list(data.shape),
            "base64": base64.b64encode(data.tobytes()).decode("ascii"),
        }
    if isinstance(value, Mapping):
        return {str(key): packed(item, f"{name}.{key}".lstrip(".")) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [packed(item, name) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": str(value)}
    if not isinstance(value, str | int | float | None):
        raise ValueError(f"{name} is a {type(value).__name__}, which a file cannot hold")
    return value


def unpacked(value: Any) -> Any:
    """The inverse of :func:`packed`, except that tuples become lists; ValueError for an invalid array."""
    if isinstance(value, list):
        return [unpacked(item) for item in value]
    if not isinstance(value, dict):
        return value
    if set(value) == {"float"}:
        return float(convert(value["float"], Literal["nan", "inf", "-inf"]))  # type: ignore[arg-type]
    if set(value) == {"dtype", "shape", "base64"}:
        stored = convert(value, PackedArray)
        array = np.frombuffer(stored.base64, dtype=np.dtype(stored.dtype)).reshape(stored.shape)
        return array.astype(array.dtype.newbyteorder("="))
    return {name: unpacked(item) for name, item in value.items()}


def format_of(path: str | Path) -> str:
    """The format that a file states, or "" for any other file."""
    try:
        return str(read(path, dict[str, Any]).get("format", ""))
    except ValueError:
        return ""


def check_version(data: Any, schema: type[Versioned]) -> None:
    """Raise ValueError if decoded JSON states another format or version than its schema."""
    if not isinstance(data, dict) or data.get("format") != schema.FORMAT:
        raise ValueError(f"the format field is not {schema.FORMAT!r}")
    version = data.get("version")
    if version != schema.VERSION:
        raise ValueError(
            f"version {str(version)[:20]} is not {schema.VERSION}, the one this program "
            f"reads{schema.UPGRADE_HINT and f'; {schema.UPGRADE_HINT}'}"
        )


def _unknown(data: Any, known: Any) -> str:
    """Path of the first field of the data that the schema does not have."""
    if isinstance(known, dict | list) and not isinstance(data, msgspec.Struct):
        for name, value in enumerate(data) if isinstance(known, list) else data.items():  # which an array lacks
            if isinstance(known, dict) and name not in known:
                return str(name)
            if below := _unknown(value, known[name]):
                return f"{name}.{below}"
    return ""


def _sentence(error: msgspec.ValidationError) -> str:
    """A sentence with the field from msgspec's message "Expected `float`, got `str` - at `$.x[1]`"."""
    message, _, field = str(error).partition(" - at `$")
    field = field.rstrip("`").lstrip(".")
    if match := re.fullmatch("Object (missing required|contains unknown) field `(.*)`", message):
        name = f"{field}.{match[2]}".lstrip(".")
        return f"the field {name!r} is missing" if "missing" in match[1] else f"there is no field {name!r}"
    if isinstance(error.__cause__, ValueError):  # a schema's own sentence
        return f"{field}: {message}" if field else message
    message = message[0].lower() + message[1:]
    return f"the field {field!r} is wrong: {message}" if field else message
