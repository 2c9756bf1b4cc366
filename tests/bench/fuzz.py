"""Hypothesis strategies of hostile input and of what our own writers write, by kind; ``make fuzz`` runs them for
FUZZ_SECONDS.

A property is a strategy and a check of what it draws. A reader gives what it read or one sentence; anything else is a
failure, and so is a round trip that is not the same to the last bit.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from exported_programs import build, write_sources
from hostile_files import TOKENS, WHOLE, places, spoiled
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from program_files import draw, write_qps
from pyarrow import parquet
from random_models import Case, cases
from test_recording_formats import FORMATS, made

from bench.derived.table import ONESHOT
from bench.export.building import EXACT, WARNINGS
from bench.export.fmu import write_fmu
from bench.export.settings import SOLVERS, ExportError, ExportSettings
from bench.messages import columns
from bench.problem_files import ProblemFileError, read
from bench.problems.protocol import RaceProblem
from bench.races.kind import open_run
from bench.rendering import c_comment, c_string, markdown, terminal, xml
from bench.store import Run, RunError
from piezo_model import HysteresisCreepModel, ModelError, ModelStructure, SelfLearningCompensator, StructureError
from piezo_model.json_file import convert, decoded, packed, unpacked
from piezo_model.recordings import Recording, RecordingError
from piezo_model.recordings.writer import write_table

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
STRUCTURE = ModelStructure.equidistant(
    n=3, m=1, x_range=(0.0, 10.0), y_range=(0.0, 5.0), creep_rates=(1.0,), sample_time=1e-3
)
MODEL = replace(HysteresisCreepModel.from_weights(STRUCTURE, STRUCTURE.straight_line), report={"headline": "fits"})
RUN_JSON = json.loads((REFERENCE / "run.json").read_text())
RUN_JSON["conditions"]["parts"] = RUN_JSON["conditions"]["parts"][:1]
FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
PROBLEM = next((REFERENCE / "problems").glob("*.npz")).read_bytes()
(FOLDER / "run").mkdir()
DOUBLES = st.floats(allow_nan=False, allow_infinity=False)
ANYTHING = st.text(st.characters(codec=None), max_size=60)


def documents(document: Mapping[str, Any]) -> st.SearchStrategy[bytes]:
    """A file that is not even close, or one with something else at one place or at several."""
    tokens = st.one_of(
        st.sampled_from(TOKENS), DOUBLES.map(repr), st.integers().map(str), st.text(max_size=20).map(json.dumps)
    )
    one = st.builds(lambda at, token: spoiled(document, at, token)[0], st.sampled_from(list(places(document))), tokens)
    return st.one_of(
        st.sampled_from(list(WHOLE.values())), st.binary(max_size=200), one, damaged(json.dumps(document).encode())
    )


def damaged(whole: bytes) -> st.SearchStrategy[bytes]:
    """Some bytes of a file are others, or its end is missing."""

    @st.composite
    def draw(pick: Any) -> bytes:
        data = bytearray(whole)
        for _ in range(pick(st.integers(1, 8))):
            data[pick(st.integers(0, len(data) - 1))] = pick(st.integers(0, 255))
        return bytes(data[: pick(st.one_of(st.just(len(data)), st.integers(0, len(data))))])

    return draw()


def refused(use: Callable[[], Any], path: Path, *errors: type[Exception]) -> None:
    """Used, or refused in a sentence that names the file."""
    try:
        use()
    except errors as error:
        if not str(error).startswith(str(path)):
            raise AssertionError(str(error)) from error


def model_file(text: bytes) -> None:
    """A model is valid or refused."""
    path = FOLDER / "m.json"
    path.write_bytes(text)
    refused(lambda: HysteresisCreepModel.load(path).simulate([0.0, 5.0]), path, ModelError)


def run_file(text: bytes) -> None:
    """Settings of a run."""
    path = FOLDER / "run" / "run.json"
    path.write_bytes(text)
    refused(lambda: open_run(path.parent), path, RunError)


def problem_file(data: bytes) -> None:
    """A program with its proof; what one byte less spoils is found by the checksums of the archive."""
    path = FOLDER / "p.npz"
    path.write_bytes(data)
    refused(lambda: RaceProblem.load(path), path, ProblemFileError)


def recording_text(text: str) -> None:
    """A table that somebody typed."""
    path = FOLDER / "stage.csv"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    refused(lambda: Recording.open(path).arrays(), path, RecordingError)


CELLS = st.one_of(
    DOUBLES.map(str),
    st.sampled_from(("", "NaN", "1,5", "1e400", "-inf", "12:30:00.5", "0x10", '"', "=1+1", "[V]", "µm")),
    ANYTHING,
)
TABLES = st.builds(
    lambda rows, sep, end: end.join(sep.join(row) for row in rows),
    st.lists(st.lists(CELLS, max_size=4), max_size=12),
    st.sampled_from((",", ";", "\t", " ")),
    st.sampled_from(("\n", "\r\n", "\r")),
)
GOOD_CSV = "time_s,drive_V,y_um\n" + "".join(
    f"{i * 1e-3:.3f},{5 * math.sin(i / 9):.6f},{3 * math.sin(i / 9 - 0.1):.6f}\n" for i in range(60)
)


def recording_parquet(data: bytes) -> None:
    """A table that somebody's disk has damaged."""
    path = FOLDER / "stage.parquet"
    path.write_bytes(data)
    refused(lambda: Recording.open(path).arrays(), path, RecordingError)


def parquet_bytes() -> bytes:
    """A good recording."""
    sink = pa.BufferOutputStream()
    t = np.arange(60) * 1e-3
    parquet.write_table(pa.table({"time_s": t, "drive_V": np.sin(50 * t), "y_um": np.cos(50 * t)}), sink)
    return bytes(sink.getvalue())


def recording_in_a_child(given: tuple[str, bytes]) -> None:
    """A binary file of any format, which a child process reads."""
    name, data = given
    path = FOLDER / ("stage.mat" if name == "MAT 4" else "stage.rec")
    path.write_bytes(data)
    refused(lambda: Recording.open(path).arrays(), path, RecordingError)


@st.composite
def binary_recordings(pick: Any) -> tuple[str, bytes]:
    """A damaged file of one of the formats."""
    name = pick(st.sampled_from([name for name in FORMATS if not name.startswith("GCS")]))
    if name not in BINARY:
        BINARY[name] = made(FOLDER, name).read_bytes()
    return name, pick(damaged(BINARY[name]))


BINARY: dict[str, bytes] = {}


def program_qps(data: bytes) -> None:
    """A program as text."""
    path = FOLDER / "p.qps"
    path.write_bytes(data)
    refused(lambda: read(path), path, ProblemFileError)


def learner_file(data: bytes) -> None:
    """What a self-learning compensator has saved."""
    path = FOLDER / "learner.json"
    path.write_bytes(data)
    refused(lambda: SelfLearningCompensator.load(path).step(0.0, 0.0), path, ModelError)


def saved_learner() -> dict[str, Any]:
    """A learner in the middle of its work."""
    learner = SelfLearningCompensator(STRUCTURE, reset_s=0.01, build_s=0.05, learn_s=0.01)
    learner.run(2.0 + np.sin(np.arange(90) / 9.0), lambda x: 0.4 * x)
    learner.save(FOLDER / "good.json")
    return dict(json.loads((FOLDER / "good.json").read_text()))


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
            return  # a text that a terminal cannot show, or no name in C
        if name == "piezo":
            build(Path(folder), "replay.c", "gcc", *WARNINGS, *EXACT, "-O0")
        else:
            subprocess.run(
                ["make", "-s", "example", f"CFLAGS={' '.join(WARNINGS)} -O0"],
                cwd=folder,
                check=True,
                capture_output=True,
            )
        if solver is None:
            write_fmu(model, chosen, Path(folder) / "stage.fmu", 2 + len(input_unit) % 2)


NAMES = st.one_of(
    st.sampled_from(("piezo", "left_axis", "core", "int", "main", "x", "sqrt", "real")),
    st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{2,40}", fullmatch=True),
    ANYTHING,
)
SHOWN = st.text(
    st.one_of(st.sampled_from("*/\\?\"'<>&%{}"), st.characters(exclude_categories=("C", "Zl", "Zp"))), max_size=60
)
CONTROLLERS = st.tuples(cases(), NAMES, SHOWN, SHOWN, st.sampled_from((None, *SOLVERS)))


def rows_file(change: tuple[str, list[Any]]) -> None:
    """Rows of a run with another column in the place of one."""
    name, values = change
    table = parquet.read_table(REFERENCE / "rows.parquet").slice(0, len(values))
    path = FOLDER / "run" / "rows.parquet"
    try:
        other = pa.array(values)
    except (pa.ArrowException, UnicodeEncodeError, OverflowError):
        return  # what no table holds
    parquet.write_table(table.set_column(table.column_names.index(name), name, other), path)
    refused(lambda: Run(path.parent).rows(ONESHOT), path, RunError)


VALUES = st.one_of(
    *(
        st.lists(values, min_size=3, max_size=3)
        for values in (
            st.none(),
            st.booleans(),
            st.integers(),
            DOUBLES,
            ANYTHING,
            st.binary(max_size=5),
            st.lists(st.integers(), max_size=3),
            st.sampled_from(("daqp", "kernel", "{}")),
        )
    )
)


def text_on_every_target(text: str) -> None:
    """Nothing of a text is markup, a command or a line of its own."""
    if not all(sign.isprintable() or sign in "\n\t" for sign in terminal(text)):
        raise AssertionError("terminal")
    if set("<>`*|[]\n\x1b") & set(markdown(text)):
        raise AssertionError("markdown")
    if set('<>"') & set(xml(text)):
        raise AssertionError("XML")
    comment, literal = c_comment(text), c_string(text)
    if set("*\\\n") & set(comment) or not (comment + literal).isascii() or "\n" in literal or "??" in literal:
        raise AssertionError("C")


def model_round_trip(weights: list[float]) -> None:
    """A model comes back as it was, to the last bit."""
    model = HysteresisCreepModel.from_weights(STRUCTURE, weights)
    model.save(FOLDER / "w.json")
    again = HysteresisCreepModel.load(FOLDER / "w.json")
    if again.weights.tobytes() != model.weights.tobytes() or again.structure != model.structure:
        raise AssertionError("another model")


def structure_round_trip(fields: Mapping[str, Any]) -> None:
    """A structure that can be comes back from JSON."""
    structure = ModelStructure((0.25, 0.5), (-0.5, 0.0, 0.5), **fields)
    if convert(decoded(json.dumps(structure.to_dict()), dict[str, Any]), ModelStructure) != structure:
        raise AssertionError("another structure")


def table_round_trip(values: list[float]) -> None:
    """Columns of a table that we write come back to the last bit."""
    x = np.array(values)
    for name in ("t.csv", "t.parquet"):
        write_table(FOLDER / name, {"drive_V": x, "y_um": -x})
        if name.endswith("parquet"):
            found = parquet.read_table(FOLDER / name)["drive_V"].to_numpy()
        else:
            found = np.array([float(line.split(",")[0]) for line in (FOLDER / name).read_text().splitlines()[1:]])
        if found.tobytes() != x.tobytes():
            raise AssertionError(name)


def memory_round_trip(value: Any) -> None:
    """What a learner's file packs comes back, NaN and the infinities included."""
    again = unpacked(decoded(json.dumps(packed(value), allow_nan=False), dict[str, Any]))
    if repr(again) != repr(value):
        raise AssertionError(repr(again))


SLOW = ("recording, binary", "controller, C and FMU")
"""Kinds with a process for each input, of which a twentieth is tried."""
POSITIVE = st.floats(1e-3, 1e3)
PROPERTIES: dict[str, tuple[st.SearchStrategy[Any], Callable[[Any], None]]] = {
    "model, JSON": (documents(MODEL.to_dict()), model_file),
    "run, JSON": (documents(RUN_JSON), run_file),
    "rows, Parquet": (st.tuples(st.sampled_from(columns.schema(("task", *ONESHOT.columns)).names), VALUES), rows_file),
    "program, NPZ": (damaged(PROBLEM), problem_file),
    "recording, text": (
        st.one_of(TABLES, damaged(GOOD_CSV.encode()).map(lambda data: data.decode("utf-8", "replace"))),
        recording_text,
    ),
    "recording, Parquet": (damaged(parquet_bytes()), recording_parquet),
    "recording, binary": (binary_recordings(), recording_in_a_child),
    "program, QPS": (damaged(write_qps(FOLDER / "good.qps", draw()).read_bytes()), program_qps),
    "learner, JSON": (documents(saved_learner()), learner_file),
    "controller, C and FMU": (CONTROLLERS, controller),
    "text": (ANYTHING, text_on_every_target),
    "model, there and back": (
        st.lists(st.floats(1e-3, 1e3), min_size=STRUCTURE.d, max_size=STRUCTURE.d),
        model_round_trip,
    ),
    "structure, there and back": (
        st.fixed_dictionaries(
            {
                "creep_rates": st.lists(POSITIVE, max_size=3, unique=True).map(tuple),
                "sample_time": st.floats(1e-9, 1e6),
                "x_centre": st.floats(-1e99, 1e99),
                "x_scale": POSITIVE,
                "y_centre": st.floats(-1e99, 1e99),
                "y_scale": POSITIVE.map(lambda v: -v),
                "offset": st.booleans(),
                "input_unit": st.text(max_size=30),
                "output_unit": st.text(max_size=30),
            }
        ),
        structure_round_trip,
    ),
    "table, there and back": (st.lists(DOUBLES, min_size=1, max_size=20), table_round_trip),
    "memory, there and back": (
        st.dictionaries(
            st.sampled_from("abcd"),
            st.one_of(
                st.floats(),
                st.integers(-(2**63), 2**63),
                st.text(max_size=5),
                st.none(),
                st.lists(st.floats(), max_size=3),
            ),
        ),
        memory_round_trip,
    ),
}


def run(kind: str, examples: int, start: int | None = None) -> int:
    """Check so many inputs of a kind; returns how many were tried."""
    strategy, check = PROPERTIES[kind]
    tried = Counter[str]()

    def counted(value: Any) -> None:
        tried[kind] += 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a valid model may have an output beyond all doubles
            check(value)

    phases = (Phase.explicit, Phase.generate, Phase.shrink)
    examples = max(examples // 20, 1) if kind in SLOW else examples
    chosen = settings(
        max_examples=examples, deadline=None, database=None, phases=phases, suppress_health_check=list(HealthCheck)
    )
    test = chosen(given(strategy)(counted))
    (test if start is None else seed(start)(test))()
    return tried[kind]


if __name__ == "__main__":
    end, tried, turn = (
        time.monotonic() + float(os.environ.get("FUZZ_SECONDS", "900")),
        Counter[str](),
        int(os.environ.get("FUZZ_SEED", "0")),
    )
    while time.monotonic() < end:
        turn += 1
        for name in PROPERTIES:
            if time.monotonic() < end:
                tried[name] += run(name, 200, turn)
    for name, count in tried.items():
        print(f"{count:9d}  {name}")
    print(f"{sum(tried.values()):9d}  inputs, and none that was taken wrongly")
    sys.exit(0)
