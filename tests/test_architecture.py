"""Imports point down only: between the three packages and between the levels inside ``bench``. The walks of a row, a
problem and an option through the benchmark are short, and drawn as they are; what the pages name exists."""

import ast
import json
import re
from dataclasses import fields
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from command_line import python

import bench
from bench.races.settings import RaceSettings

ROOT = Path(__file__).parent.parent
PACKAGES = ("bench", "piezo_model", "solvers")
LEVELS = (
    {"solvers"},
    {"piezo_model"},
    {"messages"},  # Task, Outcome, Row
    {"timing"},
    {"processes"},
    {"problem_files"},
    {"problems"},
    {"rendering"},
    {"report"},  # common parts of all reports
    {"race_table"},
    {"part_file"},
    {"store"},
    {"derived"},  # computed from a table of measurements
    {"races"},
    {"verification", "comparison", "deploy"},
    {"export", "fleet", "live"},  # made of models, also of deployed ones
    {"cli"},
)
"""From the bottom up, packages and then the parts of ``bench``; a part imports itself and lower levels only."""


def imports(path: Path, typing: bool = True) -> set[str]:
    """Names that a file imports anywhere, with or without those for type checking alone."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = {
        node
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and getattr(block.test, "id", "") == "TYPE_CHECKING" and not typing
        for node in ast.walk(block)
    }
    return {
        f"{node.module}.{alias.name}" if isinstance(node, ast.ImportFrom) else alias.name
        for node in ast.walk(tree)
        if node not in skipped
        and (isinstance(node, ast.Import) or (isinstance(node, ast.ImportFrom) and node.module and node.level == 0))
        for alias in node.names
    }


def circle(root: Path, package: str) -> list[str]:
    """Modules of a package that import each other in a circle; ``__init__`` files do not count."""
    paths = {
        ".".join(path.relative_to(root).with_suffix("").parts): path
        for path in (root / package).rglob("*.py")
        if path.name != "__init__.py"
    }
    names = {module: imports(path, typing=False) for module, path in paths.items()}
    graph = {
        module: {*found, *(name.rpartition(".")[0] for name in found)} & paths.keys() for module, found in names.items()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return sorted(set(error.args[1]))
    return []


def part_of(name: str) -> tuple[int, str]:
    """Level and name of the part that a module of ours belongs to."""
    package, inside, *_ = *name.split("."), ""
    part = inside if package == "bench" else package
    return next(i for i, parts in enumerate(LEVELS) if part in parts), part


def upward_imports(root: Path) -> list[str]:
    """Imports of a higher level, or of another part on the same one."""
    found = []
    for path in sorted(path for package in PACKAGES for path in (root / package).rglob("*.py")):
        place = path.relative_to(root).with_suffix("").parts
        if place not in (("bench", "__init__"), ("bench", "__main__")):
            level, own = part_of(".".join(place))
            for name in sorted(name for name in imports(path) if name.partition(".")[0] in PACKAGES):
                other_level, other = part_of(name)
                if other != own and other_level >= level:
                    found.append(f"{path.relative_to(root)} imports {name}")
    return found


def test_imports_point_down_only_and_in_no_circle_inside_the_model_library() -> None:
    assert (upward_imports(ROOT), circle(ROOT, "piezo_model")) == ([], [])


def test_an_import_that_points_up_or_sideways_is_found(tmp_path: Path) -> None:
    for name, line in {
        "solvers/a.py": "import piezo_model.b",
        "piezo_model/b.py": "from bench import store",
        "bench/store.py": "def f():\n from bench.races import race",
        "bench/deploy.py": "import bench.export.fmu",
        "bench/races/race.py": "from bench.races.settings import Settings\nfrom bench.messages import task",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(line)
    assert upward_imports(tmp_path) == [
        "bench/deploy.py imports bench.export.fmu",
        "bench/store.py imports bench.races.race",
        "piezo_model/b.py imports bench.store",
        "solvers/a.py imports piezo_model.b",
    ]


def test_every_solver_file_of_a_folder_holds_one_solver_of_its_name() -> None:
    from solvers import Lane, registry

    ours = [entry for entry in registry.available() if entry.lane in (Lane.KERNEL, Lane.DIRECT)]
    assert [entry.load().name for entry in ours] == [entry.name for entry in ours]


@pytest.mark.parametrize(
    ("what", "unneeded"),
    [
        ("import piezo_model", {"scipy", "pyarrow", "qpsolvers"}),
        (
            "from bench.cli import app; app.run(['--help'])",
            {"solvers", "piezo_model", "bench.report", "bench.races", "numpy", "pandas", "vl_convert"},
        ),
        ("import bench.cli.race_verbs", {"scipy.stats", "scipy.signal"}),
        (
            "from importlib import import_module; from bench.processes.child_process import PRELOADED\n"
            "for name in PRELOADED: import_module(name)",
            {"pyarrow", "pandas", "scipy.stats"},
        ),
    ],
)
def test_nothing_is_imported_before_it_is_needed(what: str, unneeded: set[str]) -> None:
    program = f"import json, sys\n{what}\nprint(json.dumps(list(sys.modules)), file=sys.stderr)"
    assert not unneeded & set(json.loads(python("-c", program).stderr))


def test_model_data_basis_and_compensator_need_numpy_msgspec_and_the_core_alone() -> None:
    program = """
import json, sys
before = set(sys.modules)
from piezo_model import Compensator, DataBasis, HysteresisCreepModel, ModelStructure, OperatorState
new = set(sys.modules) - before
print(json.dumps([name for name in new if "site-packages" in (getattr(sys.modules[name], "__file__", None) or "")]))
"""
    assert {name.partition(".")[0] for name in json.loads(python("-c", program).stdout)} <= {
        "numpy",
        "lazy_loader",
        "msgspec",
        "typing_extensions",
    }  # the last comes with msgspec


def test_every_file_that_the_pages_for_contributors_and_the_walks_name_exists_with_the_functions_beside_it() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text() + (ROOT / "docs/architecture.md").read_text()
    beside = re.findall(r"`([\w/]+\.(?:py|c|h))`((?:,? `\w+`)+)", text)
    walks = re.findall(r"^    (\S+\.py) +([\w.]+) ", bench.__doc__, re.MULTILINE)
    assert (len(beside) >= 10, len(walks) > 20) == (True, True)
    for file, names in (*beside, *((f"bench/{file}", name) for file, name in walks)):
        source = (ROOT / file).read_text()
        assert [
            name
            for name in re.findall(r"\w+", names)
            if not re.search(rf"(def|class) {name}\b|\b{name}\)?\(.*[^;]$", source, re.MULTILINE)
        ] == [], file
    assert [path for path in re.findall(r"`(\w+(?:/\w+)+\.\w+)`", text) if not (ROOT / path).is_file()] == []


FOLDER = ROOT / "bench"
TRACER = """
import sys, threading
from pathlib import Path

FOLDER, files = {folder!r}, {{"row": {{}}, "problem": {{}}}}

def walk_of(value):
    kind = type(value).__name__
    if kind in ("Table", "RecordBatch"):
        value = getattr(getattr(value, "schema", None), "names", ())
    if kind in ("RaceProblem", "CertifiedForm"):
        return "problem"
    if kind == "Measurements" or (
        kind in ("dict", "DataFrame", "Table", "RecordBatch") and "timed_gap" in value and "solver" in value
    ):
        return "row"

def profile(frame, event, result):
    name = frame.f_code.co_filename
    if event == "return" and name.startswith(FOLDER) and any(name not in found for found in files.values()):
        sys.setprofile(None)
        for walk in {{*map(walk_of, [*frame.f_locals.values(), result])}} - {{None}}:
            files[walk][name] = None
            Path({log!r}, walk).write_text("\\n".join(file.removeprefix(FOLDER + "/") for file in files[walk]))
        sys.setprofile(profile)

sys.setprofile(profile)
threading.setprofile(profile)
"""


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that rows and problems passed in a race."""
    folder = tmp_path_factory.mktemp("walked")
    (folder / "sitecustomize.py").write_text(TRACER.format(folder=str(FOLDER), log=str(folder)))
    words = "race --set paper --limit 1 --solver daqp --lane direct --scaling scaled --rounds 2 --name run --out"
    python("-m", "bench", *words.split(), folder, first=folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("walk", "most"), [("row", 16), ("problem", 11)])
def test_a_walk_passes_few_files_and_all_of_them_are_in_its_drawing(walked: Path, walk: str, most: int) -> None:
    files = (walked / walk).read_text().split()
    assert len(files) <= most, files
    row, problem = bench.__doc__.split("A problem, from")
    assert set(files) <= {*re.findall(r"[\w/]+\.py", row if walk == "row" else problem)}


@pytest.mark.parametrize("option", [each.name for each in fields(RaceSettings) if hasattr(each.type, "__metadata__")])
def test_an_option_of_a_race_is_named_in_its_settings_and_where_it_is_used(option: str) -> None:
    named = [
        path.relative_to(FOLDER)
        for path in FOLDER.rglob("*.py")
        if re.search(rf"settings\.{option}\b|^    {option}: ", path.read_text(), re.M)
    ]
    assert len(named) <= 4, named
