"""A file from outside is used, or refused in one sentence that names it; nothing else happens."""

import json
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from command_line import CommandLine, contents, in_process
from hostile_files import (
    DEEP,
    LONG,
    MODEL,
    PAYLOADS,
    STRUCTURE,
    hostile_texts,
    make_hostile,
    spoiled,
    spoiled_documents,
    spoiled_tables,
)
from pyarrow import parquet
from recording_files import text_file
from small_races import Race

from bench.deploy.deployment import Deployment
from bench.messages.task import Tier
from bench.problem_files import ProblemFileError
from bench.problems.protocol import RaceProblem
from bench.race_table import ROWS
from bench.races.runs import open_run
from bench.store import VERSION, Run, RunError
from piezo_model import (
    CompensatorBank,
    Dynamics,
    HysteresisCreepModel,
    ModelError,
    SelfLearningCompensator,
)
from piezo_model.learning.learner_file import _checksum
from solvers import Lane


def compensator_file(path: Path) -> None:
    Deployment(
        model=MODEL,
        solver="daqp",
        lane=Lane.DIRECT,
        tier=Tier.HIGH,
        settings={},
        mode="cyclic",
        x_limits=(0.0, 10.0),
        evidence={"why": ["it is right"]},
    ).save(path)


def learner_file(path: Path) -> None:
    learner = SelfLearningCompensator(STRUCTURE, build_s=0.5, learn_s=0.1)
    learner.run(np.full(700, 2.0), lambda x: 0.5 * x)
    learner.save(path)


def use_bank(path: Path) -> None:
    bank = CompensatorBank.load(path)
    assert np.isfinite(bank.run(np.full((20, len(bank)), 2.0), np.full((20, len(bank)), 1.0))).all()


def use_learner(path: Path) -> None:
    assert np.isfinite(SelfLearningCompensator.load(path).replay(np.full(20, 2.0), np.full(20, 1.0))).all()


def use_model(path: Path) -> None:
    with np.errstate(over="ignore"):  # a model of 1e90 µm/V may well
        HysteresisCreepModel.load(path).simulate([0.0, 5.0])


@pytest.mark.parametrize(
    ("write", "use"),
    [
        (MODEL.save, use_model),
        (compensator_file, Deployment.load),
        (learner_file, use_learner),
        (CompensatorBank(STRUCTURE, 2, dynamics=Dynamics((50.0,), (0.1,), (1.0,), 1e-3)).save, use_bank),
    ],
)
def test_a_damaged_file_of_ours_is_refused_in_a_sentence_that_names_it(
    tmp_path: Path, write: Callable[[Path], None], use: Callable[[Path], object]
) -> None:
    path, sentences = tmp_path / "it.json", set[str]()
    write(path)
    use(path)
    for what, text in spoiled_documents(json.loads(path.read_text())):
        path.write_bytes(signed(text))
        sentences.add(f"{what}: {refusal(what, path, use, path, ModelError)}")
    assert sum(str(path) in sentence for sentence in sentences) > 100


def refusal(what: str, path: Path, use: Callable[[object], object], given: object, refused: type[ValueError]) -> str:
    """The sentence that refuses the file by name, or "" if it is used; any other exception fails the test."""
    try:
        use(given)
    except refused as error:
        message = str(error)
    except Exception as error:
        raise AssertionError(what) from error
    else:
        return ""
    assert message.startswith(f"{path}: "), (what, message)
    assert len(message) < 1000, what
    return message


def signed(text: bytes) -> bytes:
    """The text, with the right checksum if it is a learner's, so that a wrong checksum is not the only defence."""
    try:
        content = json.loads(text)
        if content["format"] == "piezobench-learner" and isinstance(content.pop("checksum"), str):
            return json.dumps({**content, "checksum": _checksum(content)}).encode()
    except (ValueError, KeyError, TypeError, RecursionError):
        pass
    return text


@pytest.fixture
def run(clean_race: Race, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A finished run that a test may damage."""
    return Run(shutil.copytree(clean_race.run.path, tmp_path_factory.mktemp("runs") / "run"))


def test_a_run_whose_settings_do_not_fit_is_refused_by_file_and_field(run: Run) -> None:
    path = run.path / "run.json"
    for what, text in spoiled_documents(json.loads(path.read_text())):
        path.write_bytes(text)
        refusal(what, path, open_run, run.path, RunError)


@pytest.mark.parametrize(
    ("file", "read"),
    [
        ("rows.parquet", lambda run: run.rows()),
        ("times.parquet", Run.times),
        ("sentinel.parquet", Run.sentinel_samples),
    ],
)
def test_a_table_that_does_not_fit_is_refused_by_file_and_column(run: Run, file: str, read: Callable) -> None:
    path = run.path / file
    whole = path.read_bytes()
    table, good = parquet.read_table(path), read(run)
    for what, other in spoiled_tables(table):
        parquet.write_table(other, path)
        message = refusal(what, path, read, run, RunError)
        named = what == "no rows" or "twice" in message or any(repr(name) in message for name in table.column_names)
        taken = message == "" and (read(run).dtypes.equals(good.dtypes) or "nothing" in what or "no rows" in what)
        assert taken or (message and named), (what, message)
    for damaged in (b"", whole[:1000], whole[:4] + bytes(len(whole) - 8) + whole[-4:], b"PAR1" * 10):
        path.write_bytes(damaged)
        with pytest.raises(RunError, match=r"\.parquet: cannot be read"):
            read(run)


def with_field(at: tuple[str, ...], token: str) -> Callable[[Path], object]:
    """Replaces a field of a JSON file by a token."""
    return lambda path: path.write_bytes(*spoiled(json.loads(path.read_text()), at, token))


def with_rows(spoil: Callable[[pa.Table], pa.Table]) -> Callable[[Path], object]:
    """Changes the table of a Parquet file."""
    return lambda path: parquet.write_table(spoil(parquet.read_table(path)), path)


def with_column(name: str, value: object) -> Callable[[Path], object]:
    """Writes a value into every row of a column."""
    return with_rows(
        lambda table: table.set_column(table.column_names.index(name), name, pa.array([value] * len(table)))
    )


@pytest.mark.parametrize(
    ("file", "spoil", "message"),
    [
        ("run.json", lambda path: path.write_text("{"), "is not a whole JSON file"),
        ("run.json", lambda path: path.write_text("[]"), "expected `object`, got `array`"),
        *(
            (
                "run.json",
                with_field(("version",), str(number)),
                f"version {number} is not {VERSION}, the one this program",
            )
            for number in (VERSION - 1, VERSION + 1)
        ),
        ("run.json", lambda path: path.write_text(path.read_text().replace('"version"', '"x"')), "version 1 is not"),
        ("run.json", with_field(("race",), '"batch"'), "there is no field 'race'"),
        ("run.json", with_field(("settings",), '"x"'), "the field 'settings' is wrong: expected `object`, got `str`"),
        ("run.json", with_field(("settings", "rounds"), "-3"), "the field 'rounds' is wrong: expected `int` >= 0"),
        ("run.json", with_field(("settings", "limit"), "-1"), "the field 'limit' is wrong: expected `int` >= 0"),
        ("run.json", with_field(("settings", "time_limit_s"), "1e400"), "number out of range"),
        ("run.json", with_field(("settings", "seed"), LONG), "integer value out of range"),
        ("run.json", with_field(("settings", "effort"), DEEP), "maximum recursion depth"),
        ("run.json", with_field(("problems", "paper"), '["../../x"]'), "the field 'problems[...][0]' is wrong"),
        ("rows.parquet", with_rows(lambda table: table.drop_columns("status")), "has no column 'status'"),
        ("rows.parquet", with_rows(lambda table: table.slice(0, 0)), "has no rows"),
        ("rows.parquet", with_rows(lambda table: pa.concat_tables([table, table])), "occurs twice"),
        ("rows.parquet", with_column("solver", 1), "column 'solver' has type int64"),
        ("rows.parquet", with_column("settings", "{"), "column 'settings' holds text that is not settings in JSON"),
        *(
            ("rows.parquet", with_column(name, "../../evil"), f"column {name!r} holds '../../evil' in row 1, not")
            for name in ("solver", "problem_set", "problem")
        ),
        ("rows.parquet", with_column("lane", "x"), "column 'lane' holds 'x' in row 1, not one of kernel"),
    ],
)
def test_every_verb_that_reads_a_damaged_run_refuses_it_and_writes_nothing(
    clean_race: Race, run: Run, tmp_path: Path, file: str, spoil: Callable[[Path], object], message: str
) -> None:
    path = run.path / file
    spoil(path)
    for words in (
        ["report", run.path],
        ["resume", run.path],
        ["verify", run.path],
        ["compare", clean_race.run.path, run.path, "--out", tmp_path / "c"],
        ["deploy", run.path, "--out", tmp_path / "d.json", "--simulated"],
    ):
        assert re.search(f"{re.escape(str(path))}: .*{re.escape(message)}", in_process(*words).refusal)
    assert not list(tmp_path.iterdir())
    assert [*run.path.parent.iterdir()] == [run.path]


@pytest.mark.parametrize("spoilt", [b"\x00" * 20, b"{'descr': (((((((((((", b"{'shape': (10**18,)", b"'''"])
def test_a_program_whose_headers_are_damaged_is_refused(tmp_path: Path, spoilt: bytes) -> None:
    with zipfile.ZipFile(tmp_path / "p.npz", "w") as archive:
        archive.writestr("meta.npy", b"\x93NUMPY\x01\x00v\x00" + spoilt.ljust(117) + b"\n")
    with pytest.raises(ProblemFileError, match=r"p\.npz: cannot be read as NPZ"):
        RaceProblem.load(tmp_path / "p.npz")


def test_no_text_of_a_run_is_evaluated_in_a_comparison_or_a_decision(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    alone = [([name], PAYLOADS) for name in ("setting", "settings", "solver", "problem", "host")]
    for columns, payloads in (*hostile_texts(ROWS, together=True), *alone):
        shutil.rmtree(tmp_path / "run", ignore_errors=True)
        shutil.copytree(clean_race.run.path, tmp_path / "run")
        make_hostile(Run(tmp_path / "run"), "rows.parquet", set(columns) - {"task"}, payloads)
        for words in (
            ["compare", clean_race.run.path, tmp_path / "run", "--out", tmp_path / "c"],
            ["deploy", tmp_path / "run", "--out", tmp_path / "d.json", "--simulated", "--deadline", 1e6],
        ):
            call = piezobench(*words, folder=tmp_path)
            assert call.status == 0 or call.refusal
            assert not list(tmp_path.rglob("HARMED")), (columns, payloads)


HARM = """
from pathlib import Path
from solvers.direct.daqp import Daqp

Path(__file__).with_name("HARMED").touch()


class Mine(Daqp):
    name = "mine"
"""


def test_a_run_that_names_a_python_file_is_continued_only_with_that_file(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    (tmp_path / "mine.py").write_text(HARM)
    run = clean_race.unfinished(tmp_path / "run", solver_files=[str(tmp_path / "mine.py")], solvers=["daqp"])
    before, named = contents(tmp_path), f"names the Python file {tmp_path / 'mine.py'}, whose code would run; if you "
    words = ("resume", run.path, "--solver", "mine.py", "--solver", "other.py")
    for further, why in (
        ((), named),
        (words[-2:], named),
        (words[2:], f"the race did not use {tmp_path / 'other.py'}"),
    ):
        assert why in piezobench(*words[:2], *further, folder=tmp_path).refusal
        assert contents(tmp_path) == before
    run.note(lanes={**run.settings["lanes"], "mine (direct)": "0badc0de"})
    assert "raced mine (direct) in version 0badc0de, and" in piezobench(*words[:-2], folder=tmp_path).refusal
    run.note(lanes={})
    piezobench.run(*words[:-2], folder=tmp_path)
    assert "mine" in set(run.rows().solver)


def test_no_verb_for_a_finished_run_executes_the_python_files_that_it_names(
    piezobench: CommandLine, clean_race: Race, run: Run, tmp_path: Path
) -> None:
    file = str(text_file(tmp_path, HARM, name="mine.py"))
    named = {"solver_files": [file], "problem_sets": ["paper", "test_set"], "set_options": {"test_set": file}}
    run.note(settings={**run.settings["settings"], **named})
    for words in (
        ["report", run.path],
        ["resume", run.path],
        ["verify", run.path],
        ["compare", clean_race.run.path, run.path, "--out", tmp_path / "c"],
        ["deploy", run.path, "--out", tmp_path / "d.json", "--simulated", "--deadline", 1e6],
    ):
        piezobench.run(*words)
    assert not (tmp_path / "HARMED").exists()


def test_a_run_that_names_a_test_set_is_continued_only_with_its_file(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    file = text_file(tmp_path, HARM, name="mine.py")
    run = clean_race.unfinished(tmp_path / "run", problem_sets=["test_set"], set_options={"test_set": str(file)})
    assert f"names the Python file {file}, whose code would run" in piezobench("resume", run.path).refusal
    assert not (tmp_path / "HARMED").exists()
    assert "'Mine' object is not iterable" in piezobench("resume", run.path, "--test-set", file).refusal


@pytest.mark.parametrize("link", ["figures", "parts", "problems", "models"])
def test_a_run_that_links_to_another_folder_is_refused_and_that_folder_is_untouched(
    run: Run, tmp_path: Path, link: str
) -> None:
    shutil.copytree(run.path, tmp_path / "run", ignore=shutil.ignore_patterns("figures", link))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "run" / link).symlink_to(tmp_path / "elsewhere")
    for verb in ("report", "resume", "deploy"):
        assert f"{tmp_path / 'run' / link} is a link to another folder" in in_process(verb, tmp_path / "run").refusal
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_set_whose_name_is_code_is_not_exported_as_a_test_set(clean_race: Race, tmp_path: Path) -> None:
    (tmp_path / "from").mkdir()
    with np.load(next((clean_race.run.path / "problems").glob("*.npz"))) as arrays:
        meta = json.loads(str(arrays["meta"])) | {"set": 'x"""; import os; os.system("touch HARMED"); """'}
        np.savez(tmp_path / "from" / "p.npz", **{**arrays, "meta": np.array(json.dumps(meta))})
    call = in_process("problems", "--set", "foreign", "--folder", tmp_path / "from", "--export", tmp_path / "out")
    assert "there is no certified problem" in call.refusal
    assert re.search("p.npz.*the field 'set' is wrong", call.stdout)
    assert not list((tmp_path / "out").iterdir())
