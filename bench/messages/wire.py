"""What a solver's process answers, as JSON.

The process runs code of others, so its parent reads nothing but data of the type that the function states which it
asked for: a pickle could run code in the parent.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec
import numpy as np


def written(answer: Any) -> bytes:
    """The message of an answer, with arrays as shape and bytes, and what JSON lacks as text."""
    return msgspec.json.encode(
        answer, enc_hook=lambda one: (one.shape, one.tobytes()) if isinstance(one, np.ndarray) else str(one)
    )


def read(function: Callable[..., Any], message: bytes | bytearray) -> Any:
    """The answer of a function, of the type that it states; an exception for anything else."""
    return msgspec.json.decode(message, type=get_type_hints(function)["return"], dec_hook=_made)


def _made(kind: Any, value: Any) -> Any:
    """The path, or the array of the type's numbers."""
    if kind is Path:
        return Path(value)
    shape, content = msgspec.convert(value, tuple[tuple[int, ...], bytes])
    return np.frombuffer(content, get_args(get_args(kind)[1])[0]).reshape(shape)
