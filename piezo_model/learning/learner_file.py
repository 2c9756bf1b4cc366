"""The file of a self-learning compensator, or of a bank of them, in operation."""

import hashlib
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from piezo_model import checks, json_file
from piezo_model.model import ModelError


class LearnerFile(json_file.Versioned):
    """Settings and state, arrays to the bit."""

    FORMAT = "piezobench-learner"
    VERSION = 9
    UPGRADE_HINT = "save a learner's model, its field state.compensator.model, as a file, and start from that"
    settings: dict[str, Any]
    """Fields of `learning.settings.LearningSettings`, or of `bank.BankSettings`."""
    state: dict[str, Any]
    """With the model and its structure, or of a bank."""
    checksum: str
    """SHA-256 of the rest."""


def _checksum(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode("utf-8")).hexdigest()


def write_learner(path: str | Path, settings: Mapping[str, Any], state: Mapping[str, Any]) -> None:
    """Write a compensator in operation; the file is replaced as a whole."""
    content = {
        "format": LearnerFile.FORMAT,
        "version": LearnerFile.VERSION,
        "settings": json_file.packed(settings),
        "state": json_file.packed(state),
    }
    json_file.write(path, {**content, "checksum": _checksum(content)}, ModelError)


def read_learner(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings and state; ModelError names what is wrong with the file."""
    checks.check(
        not zipfile.is_zipfile(path),
        f"{path}: is an archive, as the files of banks were until version 6, not JSON of version "
        f"{LearnerFile.VERSION}, which this program reads; make the bank anew",
        ModelError,
    )
    content = msgspec.structs.asdict(json_file.read(path, LearnerFile, ModelError))
    checks.check(
        content.pop("checksum") == _checksum(content),
        f"{path}: is damaged, since its checksum is another one",
        ModelError,
    )
    with checks.refusing(ModelError, f"{path}: holds a broken array: "):
        return json_file.unpacked(content["settings"]), json_file.unpacked(content["state"])
