"""Cached results between calls, in ``$XDG_CACHE_HOME/piezobench`` or ``~/.cache/piezobench``.

Nothing depends on the cache: if it cannot be written, one warning is logged, and results are computed again.
"""

import logging
import os
import threading
from pathlib import Path

from piezo_model.atomic_file import write_text

_warned = threading.Lock()
"""Held once the warning is logged."""


def folder(name: str = "") -> Path:
    """The folder ``name`` of the cache, by default the cache itself."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "piezobench" / name


def keep(path: Path, text: str) -> None:
    """Write a file of the cache; errors are logged once."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        if _warned.acquire(blocking=False):
            logging.getLogger("piezobench").warning(
                "%s: cannot be written (%s), so nothing is kept for the next time", folder(), error.strerror
            )
