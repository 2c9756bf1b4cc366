"""Hypothesis strategies of hostile input, by kind; ``make fuzz`` runs them for FUZZ_SECONDS. ``test_border`` spoils
every field of the files of models, learners and runs.

A reader of a file returns its content or raises its own error with one sentence that names the file.
"""

import json
import math
import os
import re
import subprocess
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from exported_loops import build, write_sources
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from program_files import DRAWN
from programs import ALL
from pyarrow import parquet
from random_models import Case, cases
from recording_files import error_of
from test_recording_formats import FORMATS, made

from bench.export.building import EXACT, WARNINGS
from bench.export.fmu import write_fmu
from bench.export.settings import SOLVERS, ExportError, ExportSettings
from bench.problem_files import ProblemFileError, read
from bench.problems.protocol import RaceProblem
from bench.processes.child_process import Child, LostError
from bench.rendering import c_comment, c_string, markdown, terminal, xml
from piezo_model import StructureError
from piezo_model.json_file import decoded, packed, unpacked
from piezo_model.recordings import Recording, RecordingError

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
ANYTHING = st.text(st.characters(codec=None), max_size=60)
T = np.arange(60) * 1e-3


@st.composite
def damaged(pick: Any, whole: bytes) -> bytes:
    """A file with some bytes changed, or its end missing."""
    data = bytearray(whole)
    for _ in range(pick(st.integers(1, 8))):
        data[pick(st.integers(0, len(data) - 1))] = pick(st.integers(0, 255))
    return bytes(data[: pick(st.just(len(data)) | st.integers(0, len(data)))])


CELLS = (
    st.floats(allow_nan=False, allow_infinity=False).map(str)
    | st.sampled_from(("", "NaN", "1,5", "1e400", "-inf", "12:30:00.5", "0x10", '"', "=1+1", "[V]", "µm"))
    | ANYTHING
)
TYPED = st.builds(
    lambda rows, sep, end: end.join(sep.join(row) for row in rows).encode("utf-8", "surrogatepass"),
    st.lists(st.lists(CELLS, max_size=4), max_size=12),
    st.sampled_from((",", ";", "\t", " ")),
    st.sampled_from(("\n", "\r\n", "\r")),
)
GOOD_CSV = "time_s,drive_V,y_um\n" + "".join(
    f"{t:.3f},{5 * math.sin(111 * t):.6f},{3 * math.sin(111 * t - 0.1):.6f}\n" for t in T
)
parquet.write_table(pa.table({"time_s": T, "drive_V": np.sin(50 * T), "y_um": np.cos(50 * T)}), FOLDER / "good.parquet")


@st.composite
def binary_recordings(pick: Any) -> bytes:
    """A damaged file of one of the formats that a library reads."""
    name = pick(st.sampled_from([name for name in FORMATS if not name.startswith("GCS")]))
    path = FOLDER / name
    path.mkdir(exist_ok=True)
    return pick(damaged(made(path, name).read_bytes()))


def read_hostile(name: str, read: Callable[[Path], object], error: type[Exception], content: bytes) -> None:
    """Read a file of hostile content; AssertionError if the error does not name the file."""
    path = FOLDER / name
    path.write_bytes(content)
    refusal = str(path)
    try:
        read(path)
    except error as found:
        refusal = str(found)
    assert refusal.startswith(str(path)), refusal


CHILD = Child()


def read_in_child(path: Path) -> None:
    """Read a recording whose damage may crash a native library, which ends a command."""
    with suppress(LostError):
        if (error := CHILD.call(60.0, error_of, path)) is not None:
            raise error


NAMES = (
    st.sampled_from(("piezo", "left_axis", "core", "int", "main", "x", "sqrt", "real"))
    | st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{2,40}", fullmatch=True)
    | ANYTHING
)
UNITS = st.text(st.sampled_from("*/\\?\"'<>&%{}") | st.characters(exclude_categories=("C", "Zl", "Zp")), max_size=60)
CONTROLLERS = st.tuples(cases(), NAMES, UNITS, UNITS, st.sampled_from((None, *SOLVERS)))


def controller(given: tuple[Case, str, str, str, str | None]) -> None:
    """A model with any text in it builds as C and as an FMU without a warning, or is refused."""
    case, name, input_unit, output_unit, solver = given
    with tempfile.TemporaryDirectory(dir=FOLDER) as folder:
        try:
            structure = replace(case.structure, input_unit=input_unit, output_unit=output_unit)
            chosen = ExportSettings(name=name, **({"part": "learning", "solver": solver} if solver else {}))
            model = replace(case.model, structure=structure, report={"headline": name})
            write_sources(Path(folder), model, chosen)
        except (StructureError, ExportError):
            return  # a text that a terminal cannot show, or not a name in C
        if name == "piezo":
            build(Path(folder), "replay.c", "gcc", *WARNINGS, *EXACT, "-O0")
        else:
            flags = f"CFLAGS={' '.join(WARNINGS)} -O0"
            subprocess.run(["make", "-s", "example", flags], cwd=folder, check=True, capture_output=True)
        if solver is None:
            write_fmu(model, chosen, Path(folder) / "stage.fmu", 2 + len(input_unit) % 2)


def text_on_every_target(text: str) -> None:
    """Nothing in a text becomes markup, a command or a line of its own."""
    assert all(sign.isprintable() or sign in "\n\t" for sign in terminal(text))
    comment, literal = c_comment(text), c_string(text)
    for signs, written in (("<>`*|[]\n\x1b", markdown(text)), ('<>"', xml(text)), ("*\\\n", comment)):
        assert not set(signs) & set(written)
    assert (comment + literal).isascii()
    assert not re.search(r"\n|\?\?", literal)


SCALARS = st.floats() | st.integers(-(2**63), 2**63) | st.text(max_size=5) | st.none()


def memory_round_trip(value: Any) -> None:
    """The state in a learner's file is restored, with NaN and infinities."""
    assert repr(unpacked(decoded(json.dumps(packed(value), allow_nan=False), dict[str, Any]))) == repr(value)


SLOW = ("recording, binary", "controller, C and FMU")
"""Kinds with a process, or that take long for each input; a twentieth of the inputs is tried."""
PROPERTIES: dict[str, tuple[st.SearchStrategy[Any], Callable[[Any], None]]] = {
    "program, NPZ": (
        damaged(next((REFERENCE / "problems").glob("*.npz")).read_bytes()),
        partial(read_hostile, "p.npz", RaceProblem.load, ProblemFileError),
    ),
    "program, QPS": (
        damaged((DRAWN / "drawn.mps").read_bytes()),
        partial(read_hostile, "p.qps", read, ProblemFileError),
    ),
    "recording, text": (
        TYPED | damaged(GOOD_CSV.encode()),
        partial(read_hostile, "stage.csv", Recording.open, RecordingError),
    ),
    "recording, Parquet": (
        damaged((FOLDER / "good.parquet").read_bytes()),
        partial(read_hostile, "stage.parquet", Recording.open, RecordingError),
    ),
    "recording, binary": (binary_recordings(), partial(read_hostile, "stage.rec", read_in_child, RecordingError)),
    "controller, C and FMU": (CONTROLLERS, controller),
    "text": (ANYTHING, text_on_every_target),
    "memory, there and back": (
        st.dictionaries(st.sampled_from("abcd"), SCALARS | st.lists(st.floats(), max_size=3)),
        memory_round_trip,
    ),
}


def run(kind: str, examples: int, start: int) -> int:
    """Check inputs of a kind, drawn from a seed; return how many were tried."""
    strategy, check = PROPERTIES[kind]
    tried = 0

    @settings(
        max_examples=max(examples // 20, 1) if kind in SLOW else examples,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @seed(start)
    @given(strategy)
    def checked(value: Any) -> None:
        nonlocal tried
        tried += 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a valid model may have an output beyond all doubles
            check(value)

    checked()
    return tried


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.needs("gcc", "cc") if "FMU" in kind else ()) for kind in PROPERTIES]
)
def test_hostile_input_is_used_or_refused_in_a_sentence_that_names_the_file(kind: str) -> None:
    assert run(kind, 40 if ALL else 20, start=1) > 0


if __name__ == "__main__":
    end, turn = time.monotonic() + float(os.environ.get("FUZZ_SECONDS", "900")), int(os.environ.get("FUZZ_SEED", "0"))
    counts = Counter[str]()
    while time.monotonic() < end:
        turn += 1
        for name in PROPERTIES:
            if time.monotonic() < end:
                counts[name] += run(name, 200, turn)
    for name, count in counts.items():
        print(f"{count:9d}  {name}")
    print(f"{counts.total():9d}  inputs, none accepted wrongly")
