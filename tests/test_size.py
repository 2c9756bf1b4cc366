"""The size of the project in statements, which goes down only: a change that needs more takes something away first."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CEILINGS = {"bench": 6347, "piezo_model": 6222, "solvers": 2150, "tests": 11896, "C": 3547}
"""Most Python statements of each folder, docstrings not counted, and most semicolons of C."""
APART = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*'", re.DOTALL)
"""Comments and literals of C."""


def statements(path: Path) -> int:
    nodes = [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.stmt)]
    return sum(not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)) for node in nodes)


def size(what: str) -> int:
    if what != "C":
        return sum(map(statements, (ROOT / what).rglob("*.py")))
    files = [path for top in ("bench", "piezo_model", "solvers") for path in (ROOT / top).rglob("*.*")]
    sources = [path for path in files if re.search(r"(\.[ch]|(?<!\.html)(?<!\.md)\.jinja)$", path.name)]
    return sum(APART.sub("", path.read_text("utf-8")).count(";") for path in sources)


@pytest.mark.parametrize("what", CEILINGS)
def test_the_project_has_not_grown(what: str) -> None:
    assert size(what) <= CEILINGS[what]
