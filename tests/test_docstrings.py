"""Examples in docstrings give the results that they show."""

import doctest
import importlib
from pathlib import Path

import pytest
from programs import library, program

ROOT = Path(__file__).parent.parent
FOLDERS = ("solvers", "piezo_model", "bench", "examples/adapters", "examples/experiment")
FILES = [
    path.relative_to(ROOT)
    for folder in FOLDERS
    for path in sorted((ROOT / folder).rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]
NEEDED = {"control_systems": "control", "hysteresis_regressor": "sklearn"}


@pytest.mark.parametrize("path", FILES, ids=str)
def test_the_examples_of_a_file_print_what_they_show(path: Path) -> None:
    if path.parts[0] == "examples":
        library(NEEDED.get(path.stem, path.stem))
        module = importlib.import_module(path.stem)
    else:
        if "codegen" in path.parts:
            program("cc")
        module = importlib.import_module(".".join(path.with_suffix("").parts).removesuffix(".__init__"))
    found = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert found.attempted > 0
    assert found.failed == 0
