"""The three floors: imports point down only, bench -> piezo_model -> solvers."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FLOORS = ("solvers", "piezo_model", "bench")
FILES = [path for floor in FLOORS for path in sorted((ROOT / floor).rglob("*.py"))]


def imported(path: Path) -> set[str]:
    """Top-level packages that a file imports anywhere."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module.partition(".")[0])
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_imports_nothing_from_a_floor_above(path: Path) -> None:
    floor = FLOORS.index(path.relative_to(ROOT).parts[0])
    assert not imported(path) & set(FLOORS[floor + 1:])


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_opens_by_saying_what_it_is(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))


def test_every_solver_file_of_a_folder_holds_one_solver_of_its_name() -> None:
    from solvers import Lane, entries

    for entry in entries():
        if entry.lane in (Lane.KERNEL, Lane.DIRECT, Lane.CODEGEN):
            try:
                cls = entry.load()
            except ImportError:  # a library that is not installed here; its own tests say so
                continue
            assert cls.name == entry.name


@pytest.mark.parametrize(("what", "unneeded"), [
    ("import piezo_model", {"numba", "scipy", "pyarrow", "qpsolvers"}),
    ("from bench.cli import app; app.run(['--help'])",
     {"solvers", "piezo_model", "bench.report", "bench.races", "numba", "numpy", "pandas", "altair", "matplotlib"}),
])
def test_nothing_is_imported_before_it_is_needed(what: str, unneeded: set[str]) -> None:
    program = f"import json, sys\n{what}\nprint(json.dumps(list(sys.modules)), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not unneeded & set(json.loads(done.stderr))


def test_nothing_is_compiled_when_everything_is_imported(tmp_path: Path) -> None:
    program = "from piezo_model import *; from bench.cli.app import command_line; command_line()"
    subprocess.run([sys.executable, "-c", program], env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}, check=True)
    assert not list(tmp_path.rglob("*.nbc"))
