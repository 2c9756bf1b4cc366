"""Solvers of other packages, found by their entry points, and in files of one's own, as ``--solver FILE.py`` takes
them; the packages are real ones on the path of a real process."""

import re
from pathlib import Path

import faulty_solvers
import numpy as np
import pytest
from command_line import python, without_waiting
from programs import library
from qpsolvers import Problem

import solvers
from bench.store import Run
from solvers import registry


def installed(target: Path, entry_points: str, package: str = "tiny-solvers", version: str = "1.2.3") -> Path:
    """Put a package with one solver into a folder as an installer does."""
    module = package.replace("-", "_")
    target.mkdir(exist_ok=True)
    (target / f"{module}.py").write_text(faulty_solvers.text("tiny").replace("nobody's", package))
    metadata = target / f"{module}-{version}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
    (metadata / "entry_points.txt").write_text(f"[piezobench.solvers]\n{entry_points}\n")
    return target


def test_no_name_of_a_file_hides_a_solver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for lane, name in (("direct", "x.py"), ("direct", "x_shared.c"), ("kernel", "y.py"), ("kernel", "y_z.c")):
        (tmp_path / lane).mkdir(exist_ok=True)
        (tmp_path / lane / name).touch()
    monkeypatch.setattr(registry, "__file__", str(tmp_path / "registry.py"))
    found = {entry.name: str(entry.lane) for entry in registry.entries()}
    assert [found.get(name) for name in ("x", "x_shared", "y", "y_z")] == ["direct", None, "kernel", None]


def test_a_file_is_added_once_and_no_other_one_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_added", [])
    (tmp_path / "other").mkdir()
    path, other = (faulty_solvers.written(folder, "mine") for folder in (tmp_path, tmp_path / "other"))
    assert registry.add_file(path) == registry.add_file(path) == registry.find("mine")
    with pytest.raises(registry.RegistrationError, match=r"other/mine\.py: there is a solver mine in the lane"):
        registry.add_file(other)
    assert registry.find("mine").load().name == "mine"


@pytest.mark.slow
def test_a_solver_of_another_package_is_raced_like_ours_and_its_version_kept(tmp_path: Path) -> None:
    target = installed(tmp_path / "site", "direct.tiny = tiny_solvers:Mine")
    few = ("--set", "paper", "--limit", 1, "--budget", 0.001, "--scaling", "scaled", "--out", tmp_path, "--name", "run")
    python("-m", "bench", "race", "--solver", "tiny", *few, folder=target, first=target)
    run = Run(tmp_path / "run")
    assert run.settings["lanes"] == {"tiny (direct)": "1.2.3"}
    assert set(run.rows().query("solver == 'tiny'").status) == {"answered"}


def test_a_name_without_a_lane_is_in_the_lane_direct_and_an_unusable_class_is_absent_with_the_reason(
    tmp_path: Path,
) -> None:
    target = installed(
        tmp_path / "site",
        "tiny = tiny_solvers:Mine\ndirect.yours = tiny_solvers:Yours\nkernel.lost = "
        "tiny_solvers:Mine\n"
        "direct.gone = no_such_module:Mine",
    )
    program = (
        "import solvers\nfrom solvers.registry import describe, find\n"
        "print(find('tiny').lane, solvers.get('tiny').name)\n"
        "for name in ('yours', 'lost', 'gone'): print(describe(find(name)).absent)"
    )
    shown = python("-c", program, first=target).stdout.splitlines()
    promised = (
        "direct tiny",
        "has no Solver class Yours",
        "calls itself tiny in the lane direct, and is registered as lost in the lane kernel",
        "No module named 'no_such_module'",
    )
    assert [message in line for message, line in zip(promised, shown, strict=True)] == [True] * 4


REFUSED = {
    "direct.tiny = no_such_module:Mine": "the selected solver tiny is absent: No module named 'no_such_module'",
    "direct.daqp = tiny_solvers:Mine": "the package tiny-solvers registers a solver daqp in the lane direct, which has",
    "direct.a/b = tiny_solvers:Mine": "registers a solver as 'direct.a/b'",
    "direct.tiny = tiny_solvers": "the name is lane.name and the value module:Class",
}
RACES = """
import sys
from bench.cli.app import run
for target in sys.argv[1:]:
    sys.path.insert(0, target)
    print(run("race --solver tiny --solver daqp --lane direct --out . --name run".split()))
    sys.path.pop(0)
"""


def test_an_absent_solver_and_an_invalid_registration_end_a_race_with_the_reason_and_leave_nothing(
    tmp_path: Path,
) -> None:
    call = python("-c", RACES, *[installed(tmp_path / str(i), each) for i, each in enumerate(REFUSED)], folder=tmp_path)
    assert call.stdout.split() == ["2"] * len(REFUSED)
    said = "".join(f"piezobench race: .*{re.escape(message)}.*\n" for message in REFUSED.values())
    assert re.fullmatch(said, without_waiting(call.stderr))
    assert not (tmp_path / "run").exists()


FOLDER = Path(__file__).parents[2] / "examples" / "adapters"
ERROR = {"scipy_slsqp": 1e-6, "casadi_qrqp": 1e-12}
"""Largest error of an answer near 1 and of its duals at the tightest rung."""


@pytest.mark.parametrize("name", ERROR)
def test_a_solver_in_a_file_has_the_answers_and_duals_of_the_exact_one(name: str) -> None:
    library(name.partition("_")[0])
    cls = solvers.from_file(FOLDER / f"{name}.py").load()
    own, exact, rng = cls(**cls.ladder(1.0)[-1]), solvers.get("box_active_set"), np.random.default_rng(5)
    A, b = rng.normal(size=(2, 24, 12)), rng.normal(size=(2, 24))
    P, q = A.transpose(0, 2, 1) @ A, -np.einsum("kij,ki->kj", A, b)
    for solver in (own, exact):
        solver.setup(Problem(P[0], q[0], lb=np.zeros(12), ub=np.full(12, np.inf)))
    for data in zip(P, q, strict=True):
        for solver in (own, exact):
            solver.update(*data)
            solver.solve()
        answers = own.solution(), exact.solution()
        assert answers[0].found
        for part in ("x", "z_box"):
            found, expected = (getattr(answer, part) for answer in answers)
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=ERROR[name] * np.abs(expected).max())
