"""Run the examples of Markdown pages.

```sh        commands, each a process that must succeed; ``sh fails``: each must be refused
```python    executed, all blocks of a page in one namespace; ``python title="x.py"``: written to that file instead
```text      expected output of the block before
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from command_line import CommandLine, Finished
from programs import program

from piezo_model import plants
from piezo_model.recordings import write_table
from piezo_model.signals import decaying_triangle, multi_sine

SAMPLE_TIME = 1e-3


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the rest of the fence's line, and its text."""

    language: str
    rest: str
    text: str


def blocks(page: Path) -> Iterator[Block]:
    """Blocks of a page in order; those in a list are indented."""
    for found in re.finditer(
        r"^( *)```(\w+) *(.*?)\n(.*?)^\1```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    ):
        yield Block(found[2], found[3], re.sub(rf"^{found[1]}", "", found[4], flags=re.MULTILINE))


def commands(text: str) -> list[list[str]]:
    """Words of each line, without comments."""
    return [words for line in text.splitlines() if (words := shlex.split(line, comments=True))]


def lay_out(folder: Path) -> None:
    """Write the files that the pages assume: two recordings of a simulated actuator and a reference."""
    plant = plants.get("relay_preisach", sample_time=SAMPLE_TIME)
    for name, x in (
        ("another.csv", decaying_triangle(duration_s=2.0, sample_time=SAMPLE_TIME, low=0.0, high=150.0)),
        ("stage.csv", multi_sine(duration_s=6.0, sample_time=SAMPLE_TIME, low=0.0, high=150.0, highest_Hz=10.0)),
    ):
        plant.reset()
        y = plant.run(x)
        write_table(folder / name, {"time_s": np.arange(x.size) * SAMPLE_TIME, "voltage_V": x, "displacement_um": y})
    y_ref = decaying_triangle(duration_s=2.0, sample_time=SAMPLE_TIME, low=float(y.min()), high=float(y.max()))
    write_table(folder / "reference.csv", {"time_s": np.arange(y_ref.size) * SAMPLE_TIME, "reference_um": y_ref})


def run(page: Path, folder: Path, piezobench: CommandLine) -> None:
    """Run the blocks of a page in the current folder, and compare their output with the page."""
    names: dict[str, object] = {"__name__": "__main__"}
    printed = ""
    for block in blocks(page):
        if block.language == "sh":
            printed = "".join(
                call(words, folder, piezobench, refused=block.rest == "fails") for words in commands(block.text)
            )
        elif block.language == "python" and block.rest:
            (folder / re.sub(r'title="(.*)"', r"\1", block.rest)).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(compile(block.text, str(page), "exec"), names)
            printed = out.getvalue()
        elif block.language == "text":
            assert printed.rstrip() == block.text.rstrip(), page.name


def call(words: list[str], folder: Path, piezobench: CommandLine, refused: bool = False) -> str:
    """Output of a command, which must succeed, or be refused in one sentence."""
    if words[0] == "piezobench":
        done = piezobench(*words[1:], folder=folder)
    else:
        if words[0] == "make":
            program("cc")  # to compile what was exported
        environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
        other = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        done = Finished(other.returncode, other.stdout, other.stderr)
    assert done.status == (2 if refused else 0), (words, done.status, done.stdout, done.stderr)
    assert not refused or done.stderr.count("\n") == 1
    return done.stdout
