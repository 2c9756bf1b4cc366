"""``piezobench compare --versions``: two versions of a solver, timed in turns."""

import json
from pathlib import Path

import pytest
import slowed_solver
from command_line import CommandLine

BROKEN = """
from solvers.direct.clarabel import Clarabel


class Broken(Clarabel):
    name = "broken"

    def solve(self, warm_start=None):
        raise ArithmeticError("no pivot")
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "findings", "status"),
    [(1.0, {"no difference"}, 0), (2.0, {"slower"}, 3)],
)
def test_a_slower_version_is_found_and_the_same_version_is_not(
    piezobench: CommandLine, tmp_path: Path, factor: float, findings: set[str], status: int
) -> None:
    a, b = (slowed_solver.write(tmp_path / name, times) for name, times in (("a", 1.0), ("b", factor)))
    words = ("compare", "--versions", a, b, "--smallest", 1.5, "--fail-on", "regression")
    said = piezobench(*words, "--json")
    found = json.loads(said.stdout)
    assert (found["finding"], said.status) in {(finding, status) for finding in findings}
    assert found["low"] < found["ratio"] < found["high"]
    assert found["gap"][0] == found["gap"][1] > 0.0


def test_versions_that_cannot_be_compared_are_refused(piezobench: CommandLine, tmp_path: Path) -> None:
    a, broken, empty = slowed_solver.write(tmp_path, 1.0), tmp_path / "broken.py", tmp_path / "empty.py"
    broken.write_text(BROKEN)
    empty.write_text("")
    for words, why in (
        (("--versions", a), "two versions are compared, A.py and B.py"),
        (("--versions", a, a, a), "two versions are compared, A.py and B.py"),
        (("--versions", a, empty), "empty.py"),
        (("--versions", a, broken), "broken.py: failed at measured/afm_head: adapter_failed ArithmeticError: no pivot"),
        (("--versions", a, a, "--out", tmp_path / "out"), "is for runs"),
        ((a, a, "--set", "measured"), "needs --versions"),
    ):
        assert why in piezobench("compare", *words).refusal
