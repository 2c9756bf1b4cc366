"""What calls leave allocated."""

import tracemalloc
from collections.abc import Callable


def left_by(call: Callable[[], object], times: int) -> int:
    """Bytes that so many calls leave, after ten that may fill what is kept."""
    tracemalloc.start()
    try:
        for _ in range(10):
            call()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(times):
            call()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
