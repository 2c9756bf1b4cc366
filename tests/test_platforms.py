"""With the features of Linux hidden, the library works, and functions that need Linux refuse with the reason."""

import subprocess
import sys
from pathlib import Path

import pytest

HIDE = """
import os, signal, sys
import numpy, pandas, pyarrow.parquet, qpsolvers, scipy.optimize, scipy.sparse, subprocess  # they may use Linux

HIDDEN = ("fcntl", "grp", "pwd", "resource", "termios")

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name in HIDDEN:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

def refuse(event, words):
    if event == "open" and str(words[0]).startswith(("/proc", "/dev/shm", "/sys/")):
        raise FileNotFoundError(2, "No such file or directory", words[0])

for name in HIDDEN:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Refuse())
sys.addaudithook(refuse)
for module, starts in (
    (os, ("sched_", "fork", "posix_spawn", "setsid", "setpgrp", "killpg", "pread", "getloadavg", "sysconf", "memfd")),
    (signal, ("SIGHUP", "SIGALRM", "SIGIO", "SIGKILL", "SIGUSR", "setitimer", "ITIMER")),
):
    for name in [name for name in dir(module) if name.startswith(starts)]:
        delattr(module, name)
sys.platform = "darwin"
"""
NO_DYLD = "ignore:Could not find _dyld_image_count:RuntimeWarning"
"""threadpoolctl takes the system for a macOS, whose way to list libraries a C library of Linux lacks."""
LIBRARY = """
import numpy as np
import qpsolvers
import solvers
from piezo_model import Compensator, CompensatorBank, Recording, SelfLearningCompensator, identify, plants
from piezo_model.recordings import write_table

plant = plants.get("dense_prandtl_ishlinskii", sample_time=1e-3)
low, high = plant.x_range
t = np.arange(6000) * 1e-3
x = low + (high - low) * (0.5 + 0.5 * np.sin(4 * t) * np.linspace(1.0, 0.3, t.size))
y = plant.run(x)
for name in ("stage.csv", "stage.parquet"):
    write_table(name, {"time_s": t, "voltage_V": x, "displacement_um": y})
    model = identify(Recording.open(name))
    assert model.report["fit"]["rms_percent"] < 0.5, model.report["headline"]
    model.save("model.json")
y_ref = np.linspace(*np.quantile(y, (0.3, 0.7)), 100)
assert np.isfinite(Compensator(model, x_limits=plant.x_range).run(y_ref)).all()
learner = SelfLearningCompensator(model.structure, x_limits=plant.x_range, mode="continuous")
assert np.isfinite(learner.step(y_ref[0], y[0]))
bank = CompensatorBank(model.structure, count=9, x_limits=plant.x_range, learn=True)
assert np.isfinite(bank.step(np.full(9, y_ref[0]), np.full(9, y[0]))).all()
problem = qpsolvers.Problem(np.eye(2), np.array([-1.0, 1.0]), lb=np.zeros(2), ub=np.ones(2))
for name in ("projected_difference", "accelerated_projection", "box_active_set", "scipy_bvls"):
    solver = solvers.get(name)
    solver.setup(problem)
    np.testing.assert_allclose(solver.solve(), (1.0, 0.0), atol=1e-6)
np.savez("stage.npz", time_s=t, voltage_V=x, displacement_um=y)
try:
    Recording.open("stage.npz")
except ValueError as error:
    print(error)
"""


def elsewhere(program: str, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-W", NO_DYLD, "-c", HIDE + program, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_library_identifies_compensates_learns_and_solves_without_linux(tmp_path: Path) -> None:
    done = elsewhere(LIBRARY, tmp_path)
    assert done.stderr == ""
    assert done.stdout.endswith("in a process of its own, Linux only; text and Parquet are read everywhere\n")


@pytest.mark.parametrize("words", [("race",), ("live", "model.json", "--simulate", "relay_preisach")], ids=str)
def test_the_command_refuses_other_systems_in_one_sentence(tmp_path: Path, words: tuple[str, ...]) -> None:
    done = elsewhere("from bench.cli import main; main()", tmp_path, *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "piezobench: Linux only; on this system the library works from Python: piezo_model\n"
    assert not list(tmp_path.iterdir())
