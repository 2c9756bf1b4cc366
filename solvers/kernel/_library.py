"""The C functions of an installed library, for the compiled loop.

Their arguments and structures are facts of one version, so another version is not called.
"""

from __future__ import annotations

import ctypes
import importlib.metadata
from pathlib import Path


def addresses(distribution: str, version: str, library: Path, names: tuple[str, ...]) -> list[int]:
    """Where functions of a library stand in memory, which stays there.

    Raises
    ------
    ImportError
        Another version is installed, or its library does not have them.
    """
    if (installed := importlib.metadata.version(distribution)) != version:
        raise ImportError(f"the C interface of {distribution} is known of version {version}, and {installed} is installed")
    try:
        opened = ctypes.CDLL(str(library))
        return [_address(opened, name) for name in names]
    except (OSError, AttributeError) as error:
        raise ImportError(f"the library of {distribution} {version} does not offer its C functions here: {error}") from None


def _address(library: ctypes.CDLL, name: str) -> int:
    address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
    assert address is not None
    return address
