"""What is absent is named: features of Linux, packages of the extra ``bench``, and programs that tests need."""

import re
from importlib.metadata import requires
from pathlib import Path

import pytest
from command_line import python
from packaging.requirements import Requirement

HIDE = """
import os, signal, sys
import numpy, pyarrow.parquet, qpsolvers, scipy.optimize, scipy.sparse, subprocess  # they may use Linux

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
import h5py
import nptdms
import numpy as np
import openpyxl
import qpsolvers
import scipy.io
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
columns = {"time_s": t, "voltage_V": x, "displacement_um": y}
np.savez("stage.npz", **columns)
scipy.io.savemat("stage.mat", columns)
with h5py.File("stage.h5", "w") as file:
    file.update(columns)
with nptdms.TdmsWriter("stage.tdms") as writer:
    writer.write_segment([nptdms.ChannelObject("Stage", *column) for column in columns.items()])
book = openpyxl.Workbook()
for row in (columns, *zip(*columns.values())):
    book.active.append(list(row))
book.save("stage.xlsx")
for name in ("npz", "mat", "h5", "tdms", "xlsx"):
    np.testing.assert_allclose(Recording.open("stage." + name).x, x, rtol=1e-12)
"""


def test_the_command_refuses_other_systems_in_one_sentence_whatever_the_verb(tmp_path: Path) -> None:
    done = python("-W", NO_DYLD, "-c", f"{HIDE}from bench.cli import main; main()", "race", folder=tmp_path, status=2)
    assert (done.stdout, done.stderr) == (
        "",
        "piezobench: Linux only; on this system the library works from Python: piezo_model\n",
    )
    assert not list(tmp_path.iterdir())


ROOT = Path(__file__).parent.parent
NEEDING = {
    "chromium": "tests/bench/test_identify_page.py::test_a_skipped_transient_does_not_flatten_the_error_of_the_rest",
    "cmake": "tests/bench/test_export_c.py::test_cmake_builds_it_too",
    "gcc": "tests/solvers/test_core.py"
    "::test_the_algorithms_call_nothing_of_the_libraries_but_a_few_functions[files0-called0]",
}


def reasons(shown: str) -> list[str]:
    return [line for line in shown.splitlines() if " skipped: " in line]


@pytest.mark.slow
@pytest.mark.parametrize(("wants_all", "status", "error"), [("", 0, ""), ("1", 1, "ERROR: ")])
def test_tests_that_need_a_missing_program_are_skipped_with_one_line_that_names_it_or_fail_a_run_of_all(
    tmp_path: Path, wants_all: str, status: int, error: str
) -> None:
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "", *NEEDING.values())
    done = python(*words, folder=ROOT, status=status, PATH=str(tmp_path), PIEZOBENCH_ALL_TESTS=wants_all)
    needed = (f"{name} is not installed; on Debian, apt-get install {name}" for name in NEEDING)
    assert reasons(done.stdout) == [f"{error}1 skipped: {sentence}" for sentence in needed]


@pytest.mark.slow
def test_the_tests_of_the_paper_need_the_library_pytest_and_hypothesis_alone() -> None:
    absent = {"pandas", "quadprog", "selenium", "typer"}
    program = "import pytest; sys.exit(pytest.main(['-q', '-p', 'no:cacheprovider', 'tests/paper']))"
    shown = python("-c", REFUSE.format(absent=absent) + program, folder=ROOT, PIEZOBENCH_ALL_TESTS="").stdout
    assert {line.split("'")[1] for line in reasons(shown)} == {"pandas"}
    assert int(re.search(r"(\d+) passed", shown)[1]) >= 27


REFUSE = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {absent!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Refuse())
"""


def absent() -> set[str]:
    """Modules of the packages that only the extra ``bench`` requires."""
    needed = [Requirement(text) for text in requires("piezobench") or []]
    base = {requirement.name for requirement in needed if requirement.marker is None}
    extra = {
        requirement.name
        for requirement in needed
        if requirement.marker is not None and requirement.marker.evaluate({"extra": "bench"})
    }
    return {"vl_convert" if name == "vl-convert-python" else name for name in extra - base}


def test_the_library_identifies_compensates_learns_and_solves_without_linux_and_the_packages_of_the_command(
    tmp_path: Path,
) -> None:
    assert {"pandas", "typer"} <= absent()
    done = python("-W", NO_DYLD, "-c", REFUSE.format(absent=absent()) + HIDE + LIBRARY, folder=tmp_path)
    assert (done.stdout, done.stderr) == ("", "")


def test_the_command_says_what_to_install_if_its_packages_are_absent() -> None:
    done = python("-c", REFUSE.format(absent={"typer"}) + "from bench.cli import main; main()", status=2)
    assert done.stderr == "piezobench: the command needs the package typer: install piezobench[bench]\n"
