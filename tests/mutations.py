"""Do the tests notice mistakes? Mutations that are drawn with a fixed seed, twenty of each package.

    python tests/mutations.py [bench …]

Each is made in a copy of the tree, where the test files of the package run until a test fails: those that name the
mutated function first, then those that name its file, then the smallest. A mutation is caught, survives, or is
undecided when its processor time is over.
"""

import ast
import copy
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import namedtuple
from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDERS = {"solvers": ("solvers",), "piezo_model": ("piezo_model", "paper", "examples"), "bench": ("bench",)}
"""Packages, and the folders of their tests."""
OPPOSITES: dict[type, type] = {ast.Lt: ast.LtE, ast.Gt: ast.GtE, ast.Eq: ast.NotEq, ast.Is: ast.IsNot}
OPPOSITES |= {ast.In: ast.NotIn, ast.And: ast.Or, ast.Add: ast.Sub, ast.Mult: ast.Div}
OPPOSITES |= {other: one for one, other in OPPOSITES.items()}
COUNT, SECONDS = 20, 300
"""Mutations of each package, and the processor time of the tests for one; a test that hangs ends by itself."""
Mutation = namedtuple("Mutation", "path function node text")
"""Another text for an expression or a statement of a function."""


def applied(mutation: Mutation) -> bytes:
    """The source of the file with the mutation."""
    lines, node = mutation.path.read_bytes().splitlines(keepends=True), mutation.node
    begin = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    source = b"".join(lines)
    return source[:begin] + mutation.text.encode() + source[end:]


def mutated(node: ast.AST) -> str | None:
    """The text of a node's mutation, if it has one."""
    match other := copy.deepcopy(node):
        case ast.Compare(ops=[op]) if type(op) in OPPOSITES:
            other.ops = [OPPOSITES[type(op)]()]
        case ast.BinOp(op=op) | ast.BoolOp(op=op) if type(op) in OPPOSITES:
            other.op = OPPOSITES[type(op)]()
        case ast.Constant(value=bool() | int() | float() as value):
            return repr(not value if isinstance(value, bool) else value + 1)
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise():
            return "pass"
        case _:
            return None
    return f"({ast.unparse(other)})"


def mutations(path: Path) -> list[Mutation]:
    """All mutations of a file's functions; text is left as it is."""
    nodes = list(ast.walk(ast.parse(path.read_bytes())))
    text = {inner for node in nodes if isinstance(node, ast.JoinedStr) for inner in ast.walk(node)}
    return [
        Mutation(path, function.name, node, other)
        for function in nodes
        if isinstance(function, ast.FunctionDef)
        for statement in function.body
        for node in ast.walk(statement)
        if node not in text and (other := mutated(node)) is not None
    ]


def verdict(tree: Path, mutation: Mutation, folders: tuple[str, ...]) -> str:
    """What the tests in a copy of the tree say of a mutation."""
    files = [path for folder in folders for path in (tree / "tests" / folder).rglob("test_*.py")]
    named = [re.compile(rf"\b{word}\b") for word in (mutation.function, mutation.path.stem)]
    files.sort(key=lambda path: ([not word.search(path.read_text()) for word in named], path.stat().st_size))
    path = tree / mutation.path.relative_to(ROOT)
    path.write_bytes(applied(mutation))
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-n0", *map(str, files)],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree)},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS)),
        capture_output=True,
        text=True,
        check=False,
    )
    shutil.copy(mutation.path, path)
    first = next(iter(re.findall(r"^(?:FAILED|ERROR) (\S+)", run.stdout, re.MULTILINE)), "a crash or a hang")
    return {0: "survived", -9: "undecided"}.get(run.returncode, f"caught by {first}")


def main() -> None:
    tree = Path(tempfile.mkdtemp(prefix="mutations-")) / "tree"
    shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".git", ".venv"))
    for package in sys.argv[1:] or FOLDERS:
        possible = [each for path in sorted((ROOT / package).rglob("*.py")) for each in mutations(path)]
        for one in random.Random(package).sample(possible, COUNT):
            where = f"{one.path.relative_to(ROOT)}:{one.node.lineno}"
            print(f"{where}  {ast.unparse(one.node)} → {one.text}: {verdict(tree, one, FOLDERS[package])}", flush=True)


if __name__ == "__main__":
    main()
