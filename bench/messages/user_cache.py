"""What is found once and kept between calls: in ``$XDG_CACHE_HOME/piezobench``, or ``~/.cache/piezobench``.

Nothing depends on it: where it cannot be written, whatever it would hold is found again, and that is said once.
"""

import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path

_once = threading.Lock()
"""Taken by whoever says that nothing can be kept."""


def folder(name: str = "") -> Path:
    """A folder of the cache, or all of it."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "piezobench" / name


def keep(path: Path, write: Callable[[Path], None]) -> None:
    """Have a file of the cache written, if that can be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path)
    except OSError as error:
        if _once.acquire(blocking=False):
            logging.getLogger("piezobench").warning(
                "%s: cannot be written (%s), so nothing is kept for the next time", folder(), error.strerror
            )
