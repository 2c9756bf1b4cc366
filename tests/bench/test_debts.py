"""The problems of a resumed run, kept, missing or damaged, and the order in which a file is synced."""

import shutil
import tempfile
from pathlib import Path

import pytest
from command_line import CommandLine
from conftest import Race

from bench import problems
from bench.messages.progress import silent
from bench.races.oneshot.settings import OneshotSettings
from bench.races.run_problems import problems_of
from bench.races.settings import settings_of
from bench.store import Run, RunError
from piezo_model.atomic_file import write_text


def unfinished(clean_race: Race, tmp_path: Path) -> Run:
    """A copy of a run before its first task."""
    shutil.copytree(clean_race.run.path, tmp_path / "run")
    run = Run(tmp_path / "run")
    (run.path / "rows.parquet").unlink()
    (run.path / "tasks").mkdir()
    return run


def test_a_resumed_run_generates_no_saved_problem(
    clean_race: Race, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = unfinished(clean_race, tmp_path)
    settings = settings_of(run, OneshotSettings)

    def made(self: problems.ProblemSet) -> None:
        raise AssertionError("a saved problem is generated again")

    monkeypatch.setattr(problems.find("paper"), "problems", made)
    (loaded,) = problems_of(run, settings, silent)
    assert [loaded.name] == run.settings["problems"]["paper"]


def test_a_problem_whose_file_is_missing_is_generated_again(clean_race: Race, tmp_path: Path) -> None:
    run = unfinished(clean_race, tmp_path)
    (path,) = (run.path / "problems").iterdir()
    path.unlink()
    (loaded,) = problems_of(run, settings_of(run, OneshotSettings), silent)
    assert path.is_file()
    assert [loaded.name] == run.settings["problems"]["paper"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: whole[: len(whole) // 2],
        lambda whole: b"",
        lambda whole: b"PK nonsense",
        lambda whole: whole[:200] + bytes(400) + whole[600:],
    ],
    ids=["half", "empty", "nonsense", "hole"],
)
def test_a_damaged_problem_is_one_sentence_with_the_file_named(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path, damage: object
) -> None:
    run = unfinished(clean_race, tmp_path)
    (path,) = (run.path / "problems").iterdir()
    assert callable(damage)
    path.write_bytes(damage(path.read_bytes()))
    refusal = piezobench("resume", run.path).refusal
    assert path.name in refusal
    with pytest.raises(RunError, match="remove the file and resume"):
        run.problem("paper", run.settings["problems"]["paper"][0])


def test_an_atomic_file_is_synced_before_its_folder_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced = []

    def fsync(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").resolve())

    monkeypatch.setattr("os.fsync", fsync)
    write_text(tmp_path / "file.txt", "whole")
    assert (tmp_path / "file.txt").read_text() == "whole"
    assert [path.parent if path != tmp_path else path for path in synced] == [tmp_path, tmp_path]
    assert synced[-1] == tmp_path
    assert tempfile.gettempdir() not in map(str, synced)
