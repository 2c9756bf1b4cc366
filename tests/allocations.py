"""Memory that calls leave allocated."""

import tracemalloc
from collections.abc import Callable


def left_by(call: Callable[[], object], times: int) -> int:
    """Bytes that this many calls leave allocated, after ten that may fill caches."""
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
