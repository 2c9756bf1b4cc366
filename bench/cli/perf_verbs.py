"""The verb ``perf``: the hot kernels beside vectorised NumPy."""

from __future__ import annotations

from bench import perf


def perf_verb() -> None:
    """Time the hot kernels on this machine, beside NumPy."""
    perf.show()
