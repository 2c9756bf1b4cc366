"""What a machine lacks is skipped there with its reason, and fails where all programs are said to be installed."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
NEEDING = {
    "chromium": "tests/bench/test_identify_page.py"
    "::test_a_transient_that_is_not_counted_does_not_flatten_the_error_of_the_rest",
    "gcc": "tests/solvers/test_core.py"
    "::test_the_algorithms_call_nothing_of_the_libraries_but_memcpy_memset_sqrt_and_fabs",
    "valgrind": "tests/bench/test_realtime.py::test_callgrind_counts_the_instructions_of_a_step",
}


def on_a_bare_machine(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Tests that need a program, on a machine that has nothing but Python."""
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *NEEDING.values()],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PATH": str(folder), "PIEZOBENCH_ALL_PROGRAMS": "", **environment},
    )


def test_what_needs_a_program_that_is_not_installed_is_skipped_with_one_line_that_names_it(tmp_path: Path) -> None:
    done = on_a_bare_machine(tmp_path)
    assert done.returncode == 0, done.stdout
    lines = [line.partition(": ")[2] for line in done.stdout.splitlines() if line.startswith("SKIPPED")]
    assert sorted(lines) == [f"{name} is not installed: apt-get install {name} brings it on Debian" for name in NEEDING]


def test_it_fails_where_all_programs_are_said_to_be_installed(tmp_path: Path) -> None:
    done = on_a_bare_machine(tmp_path, PIEZOBENCH_ALL_PROGRAMS="1")
    assert done.returncode == 1
    assert "SKIPPED" not in done.stdout
    for name in NEEDING:
        assert f"{name} is not installed: apt-get install {name} brings it on Debian" in done.stdout
