"""A user's file with a real solver that waits after each update and solve."""

from pathlib import Path

SOURCE = '''"""Quadprog with a wait: each call takes {factor} times as long."""

from time import perf_counter_ns

from solvers.direct.quadprog import Quadprog


class Slowed(Quadprog):
    """The solver with a wait, and one setting beside its default: it takes turns at the same one in every race."""

    name = "slowed"

    @classmethod
    def ladder(cls, c):
        return super().ladder(c)[-1:]

    def update(self, P=None, q=None):
        self._slowly(lambda: super(Slowed, self).update(P, q))

    def solve(self, warm_start=None):
        return self._slowly(lambda: super(Slowed, self).solve(warm_start))

    def _slowly(self, call):
        began = perf_counter_ns()
        result = call()
        until = began + {factor} * (perf_counter_ns() - began)
        while {factor} > 1.0 and perf_counter_ns() < until:
            pass
        return result
'''


def write(folder: Path, factor: float) -> Path:
    """The solver's file, in a separate folder; it has the same name for every factor."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "slowed.py"
    path.write_text(SOURCE.format(factor=factor))
    return path
