"""Solver files that pretend to be faster or more accurate than they are, and an honest one."""

from pathlib import Path
from textwrap import indent

FILE = """
import ctypes, gc, os, sys, threading, time
from pathlib import Path
import numpy as np
from qpsolvers import Problem, solve_problem
from solvers.protocol import Lane, Solver, box_solution


class Mine(Solver):
    name = "{name}"
    lane = Lane.DIRECT
    algorithm = "dual active set"
    licence = "MIT"
    distribution = "nobody's"
    known = {{}}
    calls = 0

    def setup(self, problem):
        self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
        self.set_data(problem.P, problem.q)

    def set_data(self, P, q):
        self.P, self.q = self.problem.P if P is None else P, q

    def update(self, P=None, q=None):
        self.set_data(P, q)

    def right(self, P, q):
        for _ in range(2):  # slow, so that there is something to hide
            x = solve_problem(Problem(P, q, lb=self.lb, ub=self.ub), solver="daqp", primal_tol=1e-11).x
        return x

    def solve(self, warm_start=None):
        self.calls += 1
        return self.right(self.P, self.q)

    def solution(self):
        return box_solution(self.problem, self.right(self.problem.P, self.problem.q), True)

{cheat}
"""

CHEATS = {
    "honest": "",
    "caches": """
def solve(self, warm_start=None):
    key = self.q.tobytes()
    if key not in self.known:
        self.known[key] = self.right(self.P, self.q)
    return self.known[key]
""",
    "keeps_for_its_other_settings": """
@classmethod
def ladder(cls, c):
    return tuple({"steps": number} for number in ("none", 1e-9, 2e-9, 3e-9))

def solve(self, warm_start=None):
    key = self.q.tobytes()
    if self.known.get(key, (self,))[0] is self:
        self.known[key] = self, self.right(self.P, self.q)
    return self.known[key][1]
""",
    "stale": """
def update(self, P=None, q=None): pass
""",
    "lags": """
def update(self, P=None, q=None):
    self.answer = self.right(self.P, self.q)
    self.set_data(P, q)

def solve(self, warm_start=None):
    return self.answer if hasattr(self, "answer") else self.right(self.P, self.q)
""",
    "garbage": """
def solve(self, warm_start=None):
    self.calls += 1
    if self.calls == 1:
        return self.right(self.P, self.q)
    return np.random.default_rng(self.calls).uniform(1.0, 2.0, self.q.size)
""",
    "tires": """
def solve(self, warm_start=None):
    type(self).calls += 1
    if self.calls < 20 or not hasattr(self, "kept"):
        self.kept = self.right(self.P, self.q)
    return self.kept
""",
    "tires_now_and_then": """
def solve(self, warm_start=None):
    if not hasattr(self, "kept") or np.random.default_rng().random() < 0.45:
        self.kept = self.right(self.P, self.q)
    return self.kept
""",
    "mends_later": """
def solve(self, warm_start=None):
    answer = self.right(self.P, self.q)
    if self.calls == 0:
        self.calls = 1
        return answer
    handed = np.full_like(answer, 7.0)
    threading.Timer(0.001, np.copyto, (handed, answer)).start()
    return handed
""",
    "lazy": """
def solve(self, warm_start=None):
    class Later:
        def __array__(this, dtype=None, copy=None): return self.right(self.P, self.q)
    return Later()
""",
    "looks": """
def setup(self, problem):
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    for path in (Path(__file__).parent / "cheats" / "problems").iterdir():
        path.read_bytes()
""",
    "looks_into_memory": """
def setup(self, problem):
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    open(f"/proc/{os.getppid()}/mem", "rb").close()
""",
    "patches_the_clock": """
def update(self, P=None, q=None):
    from bench.timing import clock
    slow = time.perf_counter_ns
    clock.time_block.__defaults__ = (None, np.inf, lambda: slow() // 10, np.array)
    self.set_data(P, q)
""",
    "patches_and_mends": """
def update(self, P=None, q=None):
    from bench.races import worker
    time_block = vars(worker).setdefault("kept", worker.time_block)
    def forged(*arguments):
        updates, solves, answers = time_block(*arguments)
        return updates // 10, solves // 10, answers
    worker.time_block = forged
    if sys._getframe(1).f_code.co_name == "end":
        worker.time_block = time_block
    self.set_data(P, q)
""",
    "patches_the_message": """
def setup(self, problem):
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    from bench.races import worker
    known = worker.TimedSolver.block
    def forged(bench, P, q, most_ns):
        found = known(bench, P, q, most_ns)
        found.times["solve"] //= 10
        return found
    worker.TimedSolver.block = forged
""",
    "takes_time_back": """
def setup(self, problem):
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    from bench.races import worker
    known = vars(worker).setdefault("kept", worker.TimedSolver.block)
    def forged(bench, P, q, most_ns):
        found = known(bench, P, q, most_ns)
        found.times = {"update": -found.times["solve"] // 100, "solve": found.times["solve"] // 50}
        return found
    worker.TimedSolver.block = forged
""",
    "patches_the_guard": """
def setup(self, problem):
    from bench.processes import worker
    worker.MOST = 0
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    open(f"/proc/{os.getppid()}/mem", "rb").close()
""",
    "hooks": """
def update(self, P=None, q=None):
    sys.setprofile(self.ahead)
    self.set_data(P, q)

def ahead(self, frame, event, argument):
    if event == "c_call" and frame.f_code.co_name == "time_block" and "Pk" in frame.f_locals:
        self.known["next"] = frame.f_locals["qk"].tobytes(), 1
""",
    "sends_by_itself": """
def setup(self, problem):
    from multiprocessing.connection import Connection
    from bench.messages.task import Outcome
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    connections = [one for one in gc.get_objects() if isinstance(one, Connection)]
    (connection, *_) = [one for one in connections if not one.closed and one.writable]
    connection.send(Outcome(found=True, x=self.right(self.P, self.q)))
""",
    "sends_code": """
def setup(self, problem):
    from bench.races import worker
    class Code:
        def __reduce__(this):
            return exec, ("from bench.races import metrics; metrics.relative_gap = lambda *given: (0.0, 0.0)",)
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    first = worker.TimedSolver.first
    worker.TimedSolver.first = lambda bench: vars(found := first(bench)).update(message=Code()) or found

def solve(self, warm_start=None):
    return self.q
""",
    **{
        name: f"""
def setup(self, problem):
    from bench.races import worker
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    first = worker.TimedSolver.first
    worker.TimedSolver.first = lambda bench: vars(found := first(bench)).update({forged}) or found
"""
        for name, forged in {
            "counts_beyond_64_bits": "iterations=2**80",
            "has_a_status_of_its_own": "failure='excellent'",
            "calls_itself_not_run": "failure='not_run'",
        }.items()
    },
    "names_times_anew": """
def setup(self, problem):
    from bench.races import worker
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    end = worker.TimedSolver.end
    worker.TimedSolver.end = lambda *given: vars(found := end(*given)).update(times={"sample": np.arange(3)}) or found
""",
    "moves_a_folder": """
def setup(self, problem):
    self.problem, self.lb, self.ub = problem, problem.lb, problem.ub
    self.set_data(problem.P, problem.q)
    os.mkdir(Path(__file__).parent / "cheats" / "mine")
""",
    "rewrites_times": """
def solve(self, warm_start=None):
    times = sys._getframe(1).f_locals.get("solves", [])
    times[:] = [ns // 10 for ns in times]
    return self.right(self.P, self.q)
""",
    "loses_times": """
def solve(self, warm_start=None):
    del sys._getframe(1).f_locals.get("updates", [])[2:]
    return self.right(self.P, self.q)
""",
    "times_itself": """
def time_kernel(self, P, q, warm_start=None, most_ns=np.inf):
    answers = np.array([self.right(each, q[k]) for k, each in enumerate(P)])
    return np.zeros(len(q), dtype=np.int64), np.zeros(len(q), dtype=np.int64), answers
""",
    "works_ahead": """
def update(self, P=None, q=None):
    frame = sys._getframe(1).f_locals
    self.set_data(P, q)
    if "k" in frame and frame["k"] == 0:
        self.ready = {frame["q"][k].tobytes(): self.right(frame["P"][k], frame["q"][k]) for k in range(len(frame["q"]))}

def solve(self, warm_start=None):
    found = getattr(self, "ready", {}).get(self.q.tobytes())
    return self.right(self.P, self.q) if found is None else found
""",
    "works_ahead_later": """
def update(self, P=None, q=None):
    frame = sys._getframe(1).f_locals
    self.set_data(P, q)
    if "k" in frame and frame["k"] == len(frame["q"]) // 8:
        self.ready = {frame["q"][k].tobytes(): self.right(frame["P"][k], frame["q"][k]) for k in range(len(frame["q"]))}

def solve(self, warm_start=None):
    found = getattr(self, "ready", {}).get(self.q.tobytes())
    return self.right(self.P, self.q) if found is None else found
""",
    "works_ahead_at_first": """
def update(self, P=None, q=None):
    frame = sys._getframe(1).f_locals
    self.set_data(P, q)
    self.calls += 1
    if frame.get("k") == 0 and self.calls < 10:
        self.ready = {frame["q"][k].tobytes(): self.right(frame["P"][k], frame["q"][k]) for k in range(len(frame["q"]))}

def solve(self, warm_start=None):
    found = getattr(self, "ready", {}).get(self.q.tobytes())
    return self.right(self.P, self.q) if found is None else found
""",
    "answers_one_at_a_time": """
def setup(self, problem):
    from bench.races import worker
    self.problem, self.lb, self.ub, self.ready = problem, problem.lb, problem.ub, {}
    self.set_data(problem.P, problem.q)
    known = vars(worker).setdefault("kept", worker.TimedSolver.block)
    def forged(bench, P, q, most_ns):
        first = slice(1 if most_ns < np.inf else None)
        bench.solver.ready = {qk.tobytes(): self.right(Pk, qk) for Pk, qk in zip(P[first], q[first])}
        found = known(bench, P, q, most_ns)
        found.answers, found.times = found.answers[first], {name: ns[first] for name, ns in found.times.items()}
        return found
    worker.TimedSolver.block = forged

def solve(self, warm_start=None):
    found = self.ready.get(self.q.tobytes())
    return self.right(self.P, self.q) if found is None else found
""",
    "works_aside": """
def update(self, P=None, q=None):
    frame = sys._getframe(1).f_locals
    self.set_data(P, q)
    if frame.get("k") == 0:
        self.ready, self.requested = {}, threading.Event()
        threading.Thread(target=self.work, args=(frame["P"], frame["q"])).start()
        self.requested.wait()

def work(self, P, q):
    self.ready = {q[k].tobytes(): self.right(P[k], q[k]) for k in range(len(q))}
    self.requested.set()

def solve(self, warm_start=None):
    found = getattr(self, "ready", {}).get(self.q.tobytes())
    return self.right(self.P, self.q) if found is None else found
""",
}


def written(folder: Path, name: str, cheat: str | None = None) -> Path:
    """The file of one solver, with its cheat or another one."""
    path = folder / f"{name}.py"
    path.write_text(
        FILE.format(
            name=name,
            cheat=indent(CHEATS[name] if cheat is None else cheat, "    "),
        )
    )
    return path


def write_all(folder: Path) -> list[Path]:
    """A solver file for each cheat."""
    return [written(folder, name) for name in CHEATS]
