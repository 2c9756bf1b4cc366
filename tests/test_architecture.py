"""The three packages and the levels inside ``bench``: imports point down only."""

import ast
import json
import re
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FLOORS = ("solvers", "piezo_model", "bench")
LEVELS = (
    {"messages"},  # Task, Request, Outcome, Row
    {"timing"},
    {"processes"},
    {"problem_files"},
    {"problems", "stage"},
    {"store"},
    {"rendering"},
    {"report"},  # what all reports are made of
    {"derived"},  # what follows from a table of measurements
    {"races"},  # what the kinds of race share
    {"a race"},  # one kind of race, and nothing of another one
    {"comparison", "deploy", "experiment", "export", "fleet", "live"},
    {"cli"},
)
"""From the bottom up; a part imports itself and what lies below, nothing beside it."""


def imported(path: Path, typing: bool = True) -> set[str]:
    """Modules that a file imports anywhere, and what it takes of them; those for the types alone where asked for."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    left_out = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and getattr(block.test, "id", "") == "TYPE_CHECKING" and not typing
        for node in ast.walk(block)
    }
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0 and id(node) not in left_out:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import) and id(node) not in left_out:
            found |= {alias.name for alias in node.names}
    return found


def circle(root: Path, package: str) -> list[str]:
    """Modules of a package's rooms that import each other in a circle; packages' own files are doors and not
    counted."""
    paths = {
        ".".join(path.relative_to(root).with_suffix("").parts): path
        for path in (root / package).rglob("*.py")
        if path.name != "__init__.py"
    }
    names = {name: imported(path, typing=False) for name, path in paths.items()}
    graph = {
        name: {*found, *(each.rpartition(".")[0] for each in found)} & paths.keys() for name, found in names.items()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return sorted(set(error.args[1]))
    return []


def files(root: Path, floor: str) -> list[Path]:
    return sorted((root / floor).rglob("*.py"))


def climbing(root: Path) -> list[str]:
    """Imports of a floor above."""
    return [
        f"{path.relative_to(root)} imports {name}"
        for level, floor in enumerate(FLOORS)
        for path in files(root, floor)
        for name in sorted(imported(path))
        if name.partition(".")[0] in FLOORS[level + 1 :]
    ]


def looking_up(root: Path) -> list[str]:
    """Imports inside ``bench`` that do not point down."""

    def part(name: str) -> tuple[int, str]:
        _, first, *rest = *name.split("."), ""
        race = first == "races" and (root / "bench" / "races" / rest[0]).is_dir() and rest[0] != ""
        return next(i for i, parts in enumerate(LEVELS) if ("a race" if race else first) in parts), rest[
            0
        ] if race else first

    found = []
    for path in files(root, "bench"):
        place = path.relative_to(root).with_suffix("").parts
        if place[1:] in (("__init__",), ("__main__",)):
            continue
        level, own = part(".".join(place))
        found += [
            f"{path.relative_to(root)} imports {name}"
            for name in sorted(imported(path))
            if name.startswith("bench.") and part(name)[1] != own and part(name)[0] >= level
        ]
    return found


def test_no_file_imports_from_a_floor_above() -> None:
    assert climbing(ROOT) == []


def test_nothing_inside_the_bench_looks_up() -> None:
    assert looking_up(ROOT) == []


def test_no_modules_of_the_model_library_import_each_other_in_a_circle() -> None:
    assert circle(ROOT, "piezo_model") == []


def test_an_import_that_points_up_or_into_another_race_is_found(tmp_path: Path) -> None:
    for name, line in {
        "solvers/a.py": "import piezo_model.b",
        "piezo_model/b.py": "from bench import store",
        "bench/store.py": "from bench.races import kind",
        "bench/races/kind.py": "def f():\n import bench.races.one.race",
        "bench/races/one/race.py": "from bench.races.two.race import x",
        "bench/deploy.py": "import bench.export.fmu",
        "bench/races/two/race.py": "from bench.races.kind import Kind\nfrom bench.messages import task",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(line)
    assert climbing(tmp_path) == ["solvers/a.py imports piezo_model.b", "piezo_model/b.py imports bench.store"]
    assert looking_up(tmp_path) == [
        "bench/deploy.py imports bench.export.fmu",
        "bench/races/kind.py imports bench.races.one.race",
        "bench/races/one/race.py imports bench.races.two.race.x",
        "bench/store.py imports bench.races.kind",
    ]


def test_every_solver_file_of_a_folder_holds_one_solver_of_its_name() -> None:
    from solvers import Lane, entries

    for entry in entries():
        if entry.lane in (Lane.KERNEL, Lane.DIRECT, Lane.CODEGEN):
            try:
                cls = entry.load()
            except ImportError:  # a library that is not installed here; its own tests say so
                continue
            assert cls.name == entry.name


@pytest.mark.parametrize(
    ("what", "unneeded"),
    [
        ("import piezo_model", {"scipy", "pyarrow", "qpsolvers"}),
        (
            "from bench.cli import app; app.run(['--help'])",
            {"solvers", "piezo_model", "bench.report", "bench.races", "numpy", "pandas", "vl_convert"},
        ),
    ],
)
def test_nothing_is_imported_before_it_is_needed(what: str, unneeded: set[str]) -> None:
    program = f"import json, sys\n{what}\nprint(json.dumps(list(sys.modules)), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not unneeded & set(json.loads(done.stderr))


def test_model_data_basis_and_compensator_need_numpy_msgspec_and_the_core_alone() -> None:
    program = (
        "import sys; before = set(sys.modules); from piezo_model import (Compensator, DataBasis, "
        "HysteresisCreepModel, "
        "ModelStructure, OperatorState); import json; "
        "files = {name: getattr(sys.modules[name], '__file__', None) or '' for name in set(sys.modules) - "
        "before}; "
        "print(json.dumps([name for name, file in files.items() if 'site-packages' in file]))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    found = {name.partition(".")[0] for name in json.loads(done.stdout)}
    assert found <= {"numpy", "lazy_loader", "msgspec", "typing_extensions"}  # the last comes with msgspec


def test_every_file_that_contributing_names_is_there_with_the_functions_named_beside_it():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    beside = re.findall(r"`([\w/]+\.(?:py|c|h))`((?:,? `\w+`)+)", text)
    assert len(beside) > 15
    for file, names in beside:
        source = (ROOT / file).read_text()
        for name in re.findall(r"\w+", names):
            assert re.search(rf"(def|class) {name}\b|\b{name}\)?\(.*[^;]$", source, re.MULTILINE), (file, name)
    assert [path for path in re.findall(r"`(\w+(?:/\w+)+\.\w+)`", text) if not (ROOT / path).is_file()] == []
