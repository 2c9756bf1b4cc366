"""What is found once and kept between calls: in ``$XDG_CACHE_HOME/piezobench``, or ``~/.cache/piezobench``."""

from __future__ import annotations

import os
from pathlib import Path

from piezo_model.atomic_file import write_text


def folder(name: str = "") -> Path:
    """A folder of the cache, or all of it."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "piezobench" / name


def keep(path: Path, text: str) -> None:
    """Write a file of the cache, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
