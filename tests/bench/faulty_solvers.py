"""Solver files that are right on raw data, each with another fault on scaled data."""

from pathlib import Path

FILE = """
import ctypes, os, signal, subprocess, sys, threading, time
import numpy as np
from qpsolvers import Problem, Solution, solve_problem
from solvers.protocol import Lane, Solver, Unsupported, box_solution


class Mine(Solver):
    name = "{name}"
    lane = Lane.DIRECT
    algorithm = "dual active set"
    licence = "MIT"
    distribution = "nobody's"
    found, calls = True, 0
    hoard = []

    def setup(self, problem):
        self.problem = problem
        self.scaled = bool(np.allclose(np.diag(problem.P), 1.0))
        self.answer = solve_problem(problem, solver="daqp", primal_tol=1e-11).x
        if self.scaled:
            self.faulty_setup()

    def update(self, P=None, q=None):
        P = self.problem.P if P is None else P
        problem = Problem(P, q, lb=self.problem.lb, ub=self.problem.ub)
        self.answer = solve_problem(problem, solver="daqp", primal_tol=1e-11).x
        if self.scaled:
            self.faulty_update(P)

    def solve(self, warm_start=None):
        self.calls += 1
        self.x = self.answer.copy()
        if self.scaled:
            self.faulty_solve()
        return self.x

    def solution(self):
        answer = box_solution(self.problem, self.answer, self.found, status="as I say")
        if self.scaled:
            self.faulty_solution(answer)
        return answer

    def faulty_setup(self): pass
    def faulty_update(self, P): pass
    def faulty_solve(self): pass
    def faulty_solution(self, answer): pass

    def faulty_{verb}: {fault}
"""

MARKUP = "a | b \\\\| `c` <script>d</script> [e](f) &amp;\\n| g |"
FAULTS = {
    "segfaults": ("solve(self)", "ctypes.string_at(0)"),
    "aborts": ("solve(self)", "os.write(2, b'about to fall\\n'); os.abort()"),
    "exits": ("solve(self)", "os._exit(3)"),
    # In C and with the interpreter's lock held: nothing in the process itself can end it but a signal.
    "hangs": ("solve(self)", "ctypes.PyDLL(None).pause()"),
    "hoards": ("solve(self)", "[self.hoard.append(np.ones(2**22)) for _ in range(10**6)]"),
    "raises": ("solve(self)", f"raise RuntimeError('{MARKUP}')"),
    "raises_in_setup": ("setup(self)", "raise KeyError('no such setting')"),
    "raises_in_update": ("update(self, P)", "raise ValueError('cannot update \\ud800')"),
    "answers_nan": ("solve(self)", "self.x[3] = np.nan"),
    "lies": ("solve(self)", "self.x = np.maximum(self.problem.lb, 1.0)"),
    "infeasible": ("solve(self)", "self.x = self.x - 0.1"),
    "short": ("solve(self)", "self.x = self.x[:-1]"),
    "nothing": ("solution(self, answer)", "answer.found = False"),
    "odd_duals": ("solution(self, answer)", "answer.z_box = np.zeros(3)"),
    "boasts": ("solution(self, answer)", "answer.extras = {'iterations': 10**30, 'reported_us': '1 ms', 'status': 7}"),
    "miscounts": ("solution(self, answer)", "answer.extras = {'iterations': -3, 'reported_us': -np.inf}"),
    "answers_complex": ("solve(self)", "self.x = self.x + 0j"),
    "writes": ("setup(self)", "self.problem.P[0, 0] += 1.0"),
    "writes_later": ("update(self, P)", "P[0, 0] += 1.0"),
    "unrepeatable": ("solve(self)", "self.x[0] += 1e-15 * self.calls"),
    "noisy": ("solve(self)", "print('noise ' * 100); os.write(2, b'noise\\n'); sys.stderr.write('noise')"),
    "prints_much": ("setup(self)", "os.write(1, bytes(10**8))"),
    "starts_others": (
        "setup(self)",
        "self.hoard or self.hoard.extend(subprocess.Popen(['tail', '-f', __file__]) for _ in 'abc')",
    ),
    "babbles": (
        "solve(self)",
        "[os.write(k, b'babble') for k in range(99) if '/socket:' in os.path.realpath(f'/proc/self/fd/{k}')]",
    ),
    "forks": ("solve(self)", "self.calls < 3 and os.fork()"),
    "closes_descriptors": ("solve(self)", "os.closerange(0, 1000)"),
    "starts_threads": (
        "setup(self)",
        "self.hoard or self.hoard.extend(threading.Timer(5.0, abs, (1,)).start() for _ in 'abc')",
    ),
    "ignores_signals": ("solve(self)", "[signal.signal(n, signal.SIG_IGN) for n in (2, 15, 29)]; time.sleep(1000)"),
    "unsupported": ("setup(self)", "raise Unsupported('takes no | scaled data')"),
}


def write_all(folder: Path) -> list[Path]:
    """A solver file for each fault."""
    return [written(folder, name, *FAULTS[name]) for name in FAULTS]


def text(name: str, verb: str = "solve(self)", fault: str = "pass") -> str:
    """The content of the file of a solver, by default a faultless one."""
    return FILE.format(name=name, verb=verb, fault=fault)


def written(folder: Path, name: str, verb: str = "solve(self)", fault: str = "pass", more: str = "") -> Path:
    """The file of a solver, by default a faultless one, with more methods or functions at its end."""
    path = folder / f"{name}.py"
    path.write_text(text(name, verb, fault) + more)
    return path
