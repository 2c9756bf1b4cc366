"""Progress reports of long work."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the current step, the number of finished steps and the total."""


def silent(what: str, done: int, total: int) -> None:
    """Report no progress."""
