"""The walks of a row, a problem and an option through the benchmark are short, and drawn as they are."""

import ast
import re
from dataclasses import fields
from pathlib import Path

import pytest
from command_line import python

import bench
from bench.races.settings import RaceSettings

FOLDER = Path(bench.__file__).parent
LINE = re.compile(r"^    (\S+\.py) +([\w.]+) ", re.M)
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


@pytest.mark.parametrize(("walk", "most"), [("row", 16), ("problem", 11)])
def test_a_walk_passes_few_files_and_all_of_them_are_in_its_drawing(walked: Path, walk: str, most: int) -> None:
    files = (walked / walk).read_text().split()
    assert len(files) <= most, files
    row, problem = bench.__doc__.split("A problem, from")
    assert set(files) <= {*re.findall(r"[\w/]+\.py", row if walk == "row" else problem)}


def test_the_functions_that_the_walks_name_are_there() -> None:
    lines = LINE.findall(bench.__doc__ or "")
    assert len(lines) > 20
    for file, name in lines:
        tree = ast.parse((FOLDER / file).read_text())
        defined = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        assert {*name.split(".")} <= defined, (file, name)


@pytest.mark.parametrize("option", [each.name for each in fields(RaceSettings) if "help" in each.metadata])
def test_an_option_of_a_race_is_named_in_its_settings_and_where_it_is_used(option: str) -> None:
    named = [
        path.relative_to(FOLDER)
        for path in FOLDER.rglob("*.py")
        if re.search(rf"settings\.{option}\b|^    {option}: ", path.read_text(), re.M)
    ]
    assert len(named) <= 4, named
