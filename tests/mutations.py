"""Do the tests notice mistakes? Mutations that are drawn with a fixed seed, and the tests that reach them.

    python tests/mutations.py [--package bench] [--entered FILE.json]

Every test file runs once in a copy of the tree while each of its processes writes down the functions that it enters.
Then the mutations are made one after the other, and the files that enter the mutated function run, the quickest first,
until a test fails. A mutation is caught, survives, is entered by no test, or is undecided when the time is over; a hang
of a test counts as a failure. ``--entered`` keeps what the first step found for another call.
"""

import argparse
import ast
import copy
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import namedtuple
from pathlib import Path

ROOT = Path(__file__).parent.parent
BELOW = {"solvers": (), "piezo_model": ("solvers",), "bench": ("solvers", "piezo_model", "paper")}
"""Packages, and the folders of tests that cannot reach each of them."""
TRACE = """
import os, sys, threading
from contextlib import suppress
SEEN, TREE, FILE = {}, os.environ["MUTATED_TREE"] + os.sep, os.environ["MUTATED_ENTERED"]
def enter(frame, event, arg):
    code = frame.f_code
    if id(code) not in SEEN:
        SEEN[id(code)] = code
        if code.co_filename.startswith(TREE):
            with suppress(OSError), open(FILE, "a") as file:  # some may write small files only
                file.write(f"{code.co_filename.removeprefix(TREE)}:{code.co_firstlineno}\\n")
threading.settrace(enter)
sys.settrace(enter)
"""
"""Runs at the start of every process; each line is on disk at once, since tests kill processes."""
OPPOSITES: dict[type, type] = {ast.Lt: ast.LtE, ast.Gt: ast.GtE, ast.Eq: ast.NotEq, ast.Is: ast.IsNot}
OPPOSITES |= {ast.In: ast.NotIn, ast.And: ast.Or, ast.Add: ast.Sub, ast.Mult: ast.Div}
OPPOSITES |= {other: one for one, other in OPPOSITES.items()}
COUNT, SECONDS = 20, 300.0
"""Mutations of each package, and the longest that the tests may take for one."""
KINDS = ("comparison", "operator", "constant", "statement")


Mutation = namedtuple("Mutation", "path function kind node text")
"""Another text for an expression or a statement of a function."""


def applied(mutation: Mutation, source: bytes) -> bytes:
    """The source of the file with the mutation."""
    lines, node = source.splitlines(keepends=True), mutation.node
    begin = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    return source[:begin] + mutation.text.encode() + source[end:]


def mutated(node: ast.AST) -> tuple[str, str] | None:
    """Kind and text of a node's mutation, if it has one."""
    match other := copy.deepcopy(node):
        case ast.Compare(ops=[op]) if type(op) in OPPOSITES:
            other.ops = [OPPOSITES[type(op)]()]
            return "comparison", f"({ast.unparse(other)})"
        case ast.BinOp(op=op) | ast.BoolOp(op=op) if type(op) in OPPOSITES:
            other.op = OPPOSITES[type(op)]()
            return "operator", f"({ast.unparse(other)})"
        case ast.Constant(value=bool() | int() | float() as value):
            return "constant", repr(not value if isinstance(value, bool) else value + 1)
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise():
            return "statement", "pass"
    return None


def mutations(path: Path) -> list[Mutation]:
    """All mutations of a file's functions; text is left as it is."""
    nodes, name, found = list(ast.walk(ast.parse(path.read_bytes()))), str(path.relative_to(ROOT)), []
    text = {inner for node in nodes if isinstance(node, ast.JoinedStr) for inner in ast.walk(node)}
    for function in (node for node in nodes if isinstance(node, ast.FunctionDef)):
        first, *_ = (*function.decorator_list, function)
        inside = (node for statement in function.body for node in ast.walk(statement) if node not in text)
        found += [
            Mutation(name, f"{name}:{first.lineno}", kind[0], node, kind[1])
            for node in inside
            if (kind := mutated(node))
        ]
    return found


def drawn(package: str, count: int) -> list[Mutation]:
    """As many mutations of each kind, from anywhere in a package."""
    source = random.Random(package)
    found = [each for path in sorted((ROOT / package).rglob("*.py")) for each in mutations(path)]
    return [source.choice([each for each in found if each.kind == KINDS[i % len(KINDS)]]) for i in range(count)]


def failing(tree: Path, files: list[str], seconds: float, *words: str, **variables: str) -> str | None:
    """The first test of some files that fails in a copy of the tree, "" if none does; None if they take longer."""
    command = ["timeout", "-s", "KILL", str(seconds), sys.executable, "-m", "pytest", "-q", "-n0", *words, *files]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tree.parent), str(tree)]), **variables}
    log = tree.parent / "log"
    with log.open("w") as file:
        status = subprocess.run(command, cwd=tree, env=environment, stdout=file, stderr=file, check=False).returncode
    if status in (0, 5, -9):  # 5: all tests of the file are slow; -9: after the time limit
        return None if status < 0 else ""
    return ([*re.findall(r"^(?:FAILED|ERROR) (\S+)", log.read_text(), re.MULTILINE), "a crash or a hang"])[0]


def entered(tree: Path, package: str) -> dict[str, tuple[float, list[str]]]:
    """The seconds that each test file takes, and the functions that it enters."""
    (tree.parent / "sitecustomize.py").write_text(TRACE)
    found = {}
    for path in sorted((tree / "tests").rglob("test_*.py")):
        if path.parent.name not in BELOW[package]:
            began, lines, name = time.monotonic(), tree.parent / f"{path.stem}.txt", str(path.relative_to(tree))
            failed = failing(tree, [name], 1800.0, MUTATED_TREE=str(tree), MUTATED_ENTERED=str(lines))
            found[name] = time.monotonic() - began, sorted(set(lines.read_text().splitlines()))
            print(f"{found[name][0]:7.1f} s  {name}  {failed}", flush=True)
    (tree.parent / "sitecustomize.py").unlink()
    return found


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--package", choices=BELOW, action="append", default=[])
    parser.add_argument("--entered", type=Path)
    chosen = parser.parse_args()
    tree = Path(tempfile.mkdtemp(prefix="mutations-")) / "tree"
    shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".git", ".venv"))
    for package in chosen.package or BELOW:
        kept = chosen.entered or tree.parent / f"{package}.json"
        if not kept.exists():
            kept.write_text(json.dumps(entered(tree, package)))
        reached = sorted(json.loads(kept.read_text()).items(), key=lambda item: item[1][0])
        for each in drawn(package, COUNT):
            files = [name for name, (_, functions) in reached if each.function in functions]
            path, source = tree / each.path, (ROOT / each.path).read_bytes()
            path.write_bytes(applied(each, source))
            test = failing(tree, files, SECONDS, "-x") if files else ""
            path.write_bytes(source)
            verdict = "undecided" if test is None else "caught" if test else "survived" if files else "not entered"
            print(
                f"{verdict:12}{each.path}:{each.node.lineno}", ast.unparse(each.node), "→", each.text, test, flush=True
            )


if __name__ == "__main__":
    main()
