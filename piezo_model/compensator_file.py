"""The file of a self-learning compensator in operation: JSON that is there whole or not at all, arrays bit for bit.

    {"format": "piezobench-learner", "version": 3,
     "settings": {…},     fields of `learning_settings.LearningSettings`
     "memory": {…},       everything that changes while it runs, the model and its structure included
     "checksum": "…"}     SHA-256 of the rest

The file that a compensator starts from afresh is another one, `deployment`.

Arrays are {"dtype": …, "shape": […], "base64": …}, little-endian; numbers that JSON lacks are {"float": "nan"} and the like.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from piezo_model.atomic_file import write_text
from piezo_model.model import ModelError

FORMAT = "piezobench-learner"
VERSION = 3


def packed(value: Any) -> Any:
    """Return a value as JSON can hold it.

    Examples
    --------
    >>> unpacked(packed({"a": np.arange(2.0), "b": (1, math.inf)}))
    {'a': array([0., 1.]), 'b': [1, inf]}
    """
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return {"dtype": data.dtype.str, "shape": list(data.shape), "base64": base64.b64encode(data.tobytes()).decode("ascii")}
    if isinstance(value, Mapping):
        return {str(name): packed(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [packed(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": str(value)}
    return value


def unpacked(value: Any) -> Any:
    """Undo :func:`packed`; lists stay lists."""
    if isinstance(value, list):
        return [unpacked(item) for item in value]
    if not isinstance(value, dict):
        return value
    if set(value) == {"float"}:
        return float(value["float"])
    if set(value) == {"dtype", "shape", "base64"}:
        raw = base64.b64decode(value["base64"], validate=True)
        array = np.frombuffer(raw, dtype=np.dtype(value["dtype"])).reshape(value["shape"])
        return array.astype(array.dtype.newbyteorder("="))
    return {name: unpacked(item) for name, item in value.items()}


def _checksum(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode("utf-8")).hexdigest()


def write(path: str | Path, settings: Mapping[str, Any], memory: Mapping[str, Any]) -> None:
    """Write a compensator."""
    content = {"format": FORMAT, "version": VERSION, "settings": packed(settings), "memory": packed(memory)}
    write_text(path, json.dumps({**content, "checksum": _checksum(content)}, indent=1, allow_nan=False) + "\n")


def is_one(path: str | Path) -> bool:
    """Whether a readable file says of itself that it has this format."""
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False  # whoever reads it in earnest says why
    return isinstance(content, dict) and content.get("format") == FORMAT


def read(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings and memory, arrays as arrays; ModelError says what is wrong with the file."""
    content = json.loads(Path(path).read_text(encoding="utf-8"))
    if content.get("version") != VERSION:
        raise ModelError(f"{path}: version {content.get('version')!r} is not {VERSION}, the one this program reads")
    checksum = content.pop("checksum", None)
    if checksum != _checksum(content):
        raise ModelError(f"{path}: is damaged, since its checksum is another one")
    for name in ("settings", "memory"):
        if not isinstance(content.get(name), dict):
            raise ModelError(f"{path}: the field {name!r} is missing or no object")
    try:
        return unpacked(content["settings"]), unpacked(content["memory"])
    except (ValueError, TypeError, binascii.Error) as error:
        raise ModelError(f"{path}: holds a broken array ({error})") from None
