"""The walks of a row, a problem and an option through the benchmark are short, and drawn as they are."""

import ast
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

import bench
from bench.races.settings import RaceSettings

FOLDER = Path(bench.__file__).parent
LINE = re.compile(r"^    (\S+\.py) +([\w.]+) ", re.M)
TRACER = """
import sys, threading
from pathlib import Path

FOLDER, files = {folder!r}, dict()

def is_wanted(value):
    kind = type(value).__name__
    if kind in ("Table", "RecordBatch"):
        value = getattr(getattr(value, "schema", None), "names", ())
    return kind in ("RaceProblem", "CertifiedForm") if {walk!r} == "problem" else (
        kind == "Measurements" or kind in ("dict", "DataFrame", "Table", "RecordBatch")
        and "timed_gap" in value and "solver" in value
    )

def profile(frame, event, result):
    name = frame.f_code.co_filename
    if event == "return" and name.startswith(FOLDER) and name not in files:
        sys.setprofile(None)
        if any(map(is_wanted, [*frame.f_locals.values(), result])):
            files[name] = None
            Path({log!r}).write_text("\\n".join(file.removeprefix(FOLDER + "/") for file in files))
        sys.setprofile(profile)

sys.setprofile(profile)
threading.setprofile(profile)
"""


@pytest.mark.parametrize(("walk", "most"), [("row", 16), ("problem", 11)])
def test_a_walk_passes_few_files_and_all_of_them_are_in_its_drawing(tmp_path: Path, walk: str, most: int) -> None:
    tracer = TRACER.format(folder=str(FOLDER), walk=walk, log=str(tmp_path / "files"))
    (tmp_path / "sitecustomize.py").write_text(tracer)
    words = ["race", "--set", "paper", "--limit", 1, "--solver", "daqp", "--lane", "direct", "--scaling", "scaled"]
    subprocess.run(
        [sys.executable, "-m", "bench", *map(str, words), "--rounds", "2", "--out", tmp_path, "--name", "run"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        check=True,
        capture_output=True,
    )
    files = (tmp_path / "files").read_text().split()
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
