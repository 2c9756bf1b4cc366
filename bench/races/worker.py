"""The child's side of the race: set up a solver, solve one problem, then be timed on data that arrive block by block.

*Hot*: the same solver updates and solves again and again, so that its code is in the caches. *Interleaved*: one update
and solve at a time, and other solvers run on the same core in between. In both cases the clock runs in the child; the
child receives the data of a block only when it is timed, and returns its answers with the times. The parent has its own
clock and its own certificates. *Scheduled*: each sample of a block comes due at its time (`bench.timing.schedule`).
"""

import resource
from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import partial
from typing import Any

import numpy as np
from qpsolvers import Problem

from bench.messages.solver_info import solver_info
from bench.messages.task import Outcome, Task, attempt, plain
from bench.problem_files.program import fields_of
from bench.timing.clock import no_garbage_collection, time_block, time_call, time_kernel
from bench.timing.schedule import follow
from solvers.arrays import reals
from solvers.protocol import Matrix, Solver, Vector


def set_up(
    cls: type[Solver],
    first: bool,
    task: Task,
    fields: Mapping[str, Any],
    warm_start: Vector | None = None,
    c: float = 1.0,
    times_itself: bool = False,
) -> Outcome:
    """Set up a solver, and keep it for what follows, until the next set-up; the first request of a process also solves
    first, to warm up.

    Parameters
    ----------
    cls, first : type of Solver, bool
        As of `bench.processes.worker.answer`.
    task : Task
    fields : mapping
        The program by field.
    warm_start : array (d,), optional
        Start of every solve; cold by default.
    c : float
        Constant of the problem, which scales the solver's ladder.
    times_itself : bool
        Whether the clock runs inside compiled code.
    """

    def run() -> Outcome:
        solver = _ready[task.key] = TimedSolver(cls, task, fields, warm_start, c, times_itself)
        solver.setups.append(solver.setup())
        return Outcome(found=True)

    _ready.clear()
    if first:
        attempt(lambda: run() and _ready[task.key].first())
    return attempted(task.key, run)


def further(cls: type[Solver], first: bool, key: str, method: Callable[..., Outcome], *arguments: Any) -> Outcome:
    """Call a method of the :class:`TimedSolver` that is ready for the task of this key."""
    return attempted(key, lambda: method(_ready[key], *arguments))


def attempted(key: str, work: Callable[[], Outcome]) -> Outcome:
    """The outcome of work with the solver of a task, which is not ready any more if it fails."""
    outcome = attempt(work)
    if outcome.failure and (failed := _ready.pop(key, None)) is not None:
        outcome.mutated, outcome.settings = failed.were_inputs_changed(), failed.settings
    return outcome


_ready: dict[str, "TimedSolver"] = {}
"""The solver of this process that is ready for blocks, by the key of its task."""


class TimedSolver:
    """A solver that is set up on a problem, with separate arrays for updates; the parameters are those of `set_up`."""

    def __init__(
        self,
        cls: type[Solver],
        task: Task,
        fields: Mapping[str, Any],
        warm_start: Vector | None,
        c: float,
        times_itself: bool,
    ) -> None:
        self._made_again = partial(TimedSolver, cls, task, fields, warm_start, c, times_itself)
        program = Problem(**fields)
        # Two copies, since a solver that writes into one must spoil neither the other nor the request.
        self._for_setup, self._for_update = deepcopy(program), deepcopy(program)
        self._start = None if warm_start is None else warm_start.copy()
        self._content = self._bytes()
        self._time = time_kernel if times_itself else time_block
        settings = task.settings_for(cls, c)
        self.solver, self.settings = cls(**settings), plain(settings)
        self._solve: Callable[[], Any] = (
            self.solver.solve if self._start is None else partial(self.solver.solve, self._start)
        )
        self.setups: list[int] = []
        self._block_was_changed = False

    def first(self) -> Outcome:
        """Solve the problem of the set-up."""
        self._first = x = np.array(reals("its answer", self._solve()))
        return Outcome(x=x, settings=self.settings, **solver_info(self.solver.solution()))

    def setup(self) -> int:
        """Nanoseconds of one set-up."""
        return time_call(partial(self.solver.setup, self._for_setup))

    def block(self, P: Matrix | None, q: Matrix, most_ns: float) -> Outcome:
        """Time update and solve for each P (n, d, d), None if it is fixed, and q (n, d), and check that the data are
        unchanged afterwards. No call begins after ``most_ns`` are spent."""
        data, before = [q] if P is None else [P, q], preemptions()
        sums = [array.sum() for array in data]
        updates, solves, answers = self._time(self.solver, P, q, self._start, most_ns)
        self._block_was_changed |= [array.sum() for array in data] != sums
        return Outcome(
            found=True,
            preemptions=preemptions() - before,
            times={"update": updates, "solve": solves},
            answers=answers,
        )

    def scheduled(self, P: Matrix | None, q: Matrix) -> Outcome:
        """Update and solve on the schedule, sample k with P[k] (n, d, d), None if it is fixed, and q[k] (n, d); the
        answer of each solve is copied within its time. ``sample`` says to which sample it is, and ``response`` when
        each sample was answered."""
        answers, x, Ps = np.full(q.shape, np.nan), np.zeros(q.shape[1]), [None] * len(q) if P is None else P

        def solve() -> None:
            x[:] = self._solve()

        def keep(j: int) -> None:
            answers[j] = x

        before = preemptions()
        with no_garbage_collection():
            times = follow(len(q), lambda k: self.solver.update(Ps[k], q[k]), solve, keep)
        return Outcome(
            found=True,
            preemptions=preemptions() - before,
            times=times,
            answers=answers[: times["sample"].size],
        )

    def end(self, budget_s: float, is_fixed: bool) -> Outcome:
        """Whether the first data, of which P ``is_fixed`` or not, give the first answer again, and whether the inputs
        are unchanged; further set-ups are timed within the budget."""
        P = self._for_update.P if isinstance(self._for_update.P, np.ndarray) else self._for_update.P.toarray()
        self.solver.update(P=None if is_fixed else P, q=self._for_update.q)  # which takes dense data
        again = reals("its answer", self._solve())
        changed = self.were_inputs_changed()
        for _ in range(2):
            if sum(self.setups) < budget_s * 1e9:
                self.setups.append(self._made_again().setup())
        return Outcome(
            found=True,
            repeatable=bool(np.array_equal(self._first, again, equal_nan=True)),
            mutated=changed,
            times={"setup": np.array(self.setups, dtype=np.int64)},
        )

    def were_inputs_changed(self) -> bool:
        """Whether the solver wrote into an array that it was given."""
        return self._block_was_changed or self._bytes() != self._content

    def _bytes(self) -> list[bytes]:
        """Contents of every array that the solver gets outside blocks."""
        starts = [] if self._start is None else [self._start]
        return [array.tobytes() for array in (*arrays(self._for_setup), *arrays(self._for_update), *starts)]


def preemptions() -> int:
    """Number of involuntary context switches of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw


def arrays(problem: Problem) -> list[Any]:
    """Every array of a problem, those of sparse matrices too."""
    return [
        array
        for value in fields_of(problem).values()
        if value is not None
        for array in ([value] if isinstance(value, np.ndarray) else [value.data, value.indices, value.indptr])
    ]
