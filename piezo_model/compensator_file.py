"""The file of a self-learning compensator in operation: JSON, replaced as a whole, with arrays to the bit.

    {"format": "piezobench-learner", "version": 8,
     "settings": {…},     fields of `learning.settings.LearningSettings`
     "state": {…},        the state, including the model and its structure
     "checksum": "…"}     SHA-256 of the rest

Arrays are packed as in `json_file`. A new compensator starts from another kind of file, `deployment`.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from piezo_model import json_file
from piezo_model.atomic_file import write_text
from piezo_model.json_file import packed, unpacked
from piezo_model.model import ModelError


class LearnerFile(json_file.Versioned):
    """The content of the file."""

    FORMAT = "piezobench-learner"
    VERSION = 8
    UPGRADE_HINT = "save its model, the field state.compensator.model, as a file of its own, and start from that"
    settings: dict[str, Any]
    state: dict[str, Any]
    checksum: str


def _checksum(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode("utf-8")).hexdigest()


def write(path: str | Path, settings: Mapping[str, Any], state: Mapping[str, Any]) -> None:
    """Write a compensator."""
    content = {
        "format": LearnerFile.FORMAT,
        "version": LearnerFile.VERSION,
        "settings": packed(settings),
        "state": packed(state),
    }
    write_text(path, json.dumps({**content, "checksum": _checksum(content)}, indent=1, allow_nan=False) + "\n")


def read(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings and state; ModelError names what is wrong with the file."""
    file = json_file.read(path, LearnerFile, ModelError)
    content = {"format": file.format, "version": file.version, "settings": file.settings, "state": file.state}
    if file.checksum != _checksum(content):
        raise ModelError(f"{path}: is damaged, since its checksum is another one")
    try:
        return unpacked(file.settings), unpacked(file.state)
    except ValueError as error:
        raise ModelError(f"{path}: holds a broken array ({json_file.brief(error)})") from None
