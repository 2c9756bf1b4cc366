"""The run ends with the reasons of skipped tests, and fails if nothing may be skipped."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from test_library_alone import REFUSE

ROOT = Path(__file__).parent.parent
NEEDING = {
    "chromium": "tests/bench/test_identify_page.py::test_a_skipped_transient_does_not_flatten_the_error_of_the_rest",
    "cmake": "tests/bench/test_export_c.py::test_cmake_builds_it_too",
    "gcc": "tests/solvers/test_core.py"
    "::test_the_algorithms_call_nothing_of_the_libraries_but_a_few_functions[files0-called0]",
}


def on_a_bare_machine(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run tests that need programs, on a machine that only has Python."""
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "", *NEEDING.values()],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PATH": str(folder), "PIEZOBENCH_ALL_TESTS": "", **environment},
    )


def reasons(done: subprocess.CompletedProcess[str]) -> list[str]:
    return [line for line in done.stdout.splitlines() if " skipped: " in line]


def sentence(name: str) -> str:
    return f"{name} is not installed; on Debian, apt-get install {name}"


def test_tests_that_need_a_missing_program_are_skipped_with_one_line_that_names_it(tmp_path: Path) -> None:
    done = on_a_bare_machine(tmp_path)
    assert done.returncode == 0, done.stdout
    assert reasons(done) == [f"1 skipped: {sentence(name)}" for name in NEEDING]


def test_the_run_fails_if_nothing_may_be_skipped(tmp_path: Path) -> None:
    done = on_a_bare_machine(tmp_path, PIEZOBENCH_ALL_TESTS="1")
    assert done.returncode == 1
    assert reasons(done) == [f"ERROR: 1 skipped: {sentence(name)}" for name in NEEDING]


@pytest.mark.slow
def test_the_tests_of_the_paper_need_the_library_and_pytest_alone() -> None:
    absent = {"hypothesis", "pandas", "quadprog", "selenium", "typer"}
    program = "import pytest; sys.exit(pytest.main(['-q', '-p', 'no:cacheprovider', 'tests/paper']))"
    done = subprocess.run(
        [sys.executable, "-c", REFUSE.format(absent=absent) + program],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PIEZOBENCH_ALL_TESTS": ""},
    )
    assert done.returncode == 0, done.stdout
    assert {line.split("'")[1] for line in reasons(done)} == {"pandas"}
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) > 40
