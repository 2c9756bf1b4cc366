"""A run on disk is complete or can be completed, whenever the process that writes it is killed."""

import json
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import killed_run
import pandas as pd
import pytest
from command_line import CommandLine, python
from small_races import SMALL, THIRD, Race

from bench import problems
from bench.messages.task import silent
from bench.race_table import MISSES, ROWS, complete
from bench.races.run_problems import problems_of
from bench.races.runs import settings_of
from bench.store import Run, RunError
from bench.timing import machine
from piezo_model.atomic_file import write_text

TIMES = [
    "setup_us",
    "update_us",
    "solve_us_p50",
    "solve_us_p99",
    "solve_us_max",
    "answer_us",
    "cpu_us",
    "samples",
    "periods",
    "reported_us",
    "preemptions",
    "judged",
    "draw_seed",
    *MISSES.values(),
    *(name for name in ROWS.names if name.startswith("timed_")),
]


def of_first_answers(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of the first pass without the results of timing, timed answers included, since each race draws their
    data anew; which solvers are timed again depends on the times. The key of a machine depends on the libraries that a
    process has loaded."""
    return rows[rows.timed == "hot"].drop(columns=[*TIMES, "machine"]).reset_index(drop=True)


def test_a_run_killed_at_any_step_on_disk_is_resumed_with_nothing_lost_or_twice(tmp_path: Path) -> None:
    whole, copies = tmp_path / "whole", tmp_path / "copies"
    for folder in (whole, copies):
        folder.mkdir()
    python(killed_run.__file__, whole, copies)
    unbroken = Run(whole / "run")
    assert len(unbroken.rows()) == 4
    folders = list(copies.iterdir())
    assert len(folders) > 30
    for folder in folders:
        run = Run(folder / "run")
        assert (run.settings, visible(run)) == (unbroken.settings, visible(unbroken)), f"killed at step {folder.name}"
        pd.testing.assert_frame_equal(run.rows(), unbroken.rows())


def visible(run: Run) -> list[Path]:
    """Files and folders of a run that are not hidden."""
    return sorted(path.relative_to(run.path) for path in run.path.rglob("[!.]*") if ".parts" not in path.parts)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk that is full after a few tasks; an ordinary folder if it cannot be mounted."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = (
        os.geteuid() == 0
        and subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=200k", "none", str(disk)], check=False, capture_output=True
        ).returncode
        == 0
    )
    yield disk
    if mounted:
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.slow
def test_a_full_disk_is_one_sentence_and_the_race_is_resumed_when_there_is_space(
    piezobench: CommandLine, small_disk: Path, clean_race: Race
) -> None:
    run, full = Run(small_disk / "run"), small_disk.is_mount()
    call = piezobench("race", *SMALL, *THIRD, "--out", small_disk, "--name", "run", largest_file=0 if full else 100_000)
    for words in ("No space left on device" if full else "File too large", f"piezobench resume {run.path}"):
        assert words in call.refusal
    assert not [path for path in run.path.rglob("*") if path.is_file() and path.name.startswith(".")]
    with pytest.raises(RunError, match="was not finished"):
        run.rows()
    if full:
        subprocess.run(["mount", "-o", "remount,size=10m", str(small_disk)], check=True)
    piezobench.run("resume", run.path)
    assert not run.rows().duplicated(["task", "timed"]).any()
    pd.testing.assert_frame_equal(of_first_answers(run.rows()), of_first_answers(clean_race.rows))


def test_only_one_process_may_work_on_a_run(clean_race: Race, piezobench: CommandLine, tmp_path: Path) -> None:
    run = Run.create(tmp_path, clean_race.run.settings, "run")
    for _ in range(2):
        with run.exclusive():
            assert "another process is at work on this run" in piezobench("resume", run.path).refusal
            assert not run.is_finished()


def test_a_run_that_is_finished_or_has_a_task_is_not_discarded(clean_race: Race, tmp_path: Path) -> None:
    clean_race.copied(tmp_path / "finished").discard()
    assert (tmp_path / "finished" / "rows.parquet").is_file()
    new = Run.create(tmp_path, {"settings": {}}, "new")
    part = new.part("one")
    with part.appended():
        part.save(complete(task="one"), {})
    new.discard()
    assert new.path.is_dir()
    part.path.unlink()
    new.discard()
    assert not new.path.exists()


def test_a_resumed_run_generates_a_problem_again_only_if_its_file_is_missing(
    clean_race: Race, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = clean_race.unfinished(tmp_path / "run")
    (path,) = (run.path / "problems").iterdir()
    settings, names = settings_of(run), run.settings["problems"]["paper"]
    with monkeypatch.context() as patch:
        patch.setattr(problems.find("paper"), "problems", lambda self: pytest.fail("a problem is generated again"))
        assert [problem.name for problem in problems_of(run, settings, silent)] == names
    path.unlink()
    assert [problem.name for problem in problems_of(run, settings, silent)] == names
    assert path.is_file()


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
    piezobench: CommandLine, clean_race: Race, tmp_path: Path, damage: Callable[[bytes], bytes]
) -> None:
    run = clean_race.unfinished(tmp_path / "run")
    (path,) = (run.path / "problems").iterdir()
    path.write_bytes(damage(path.read_bytes()))
    assert path.name in piezobench("resume", run.path).refusal
    with pytest.raises(RunError, match="remove the file and resume"):
        run.problem("paper", run.settings["problems"]["paper"][0])


def test_an_atomic_file_is_synced_before_its_folder_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced = []
    monkeypatch.setattr("os.fsync", lambda number: synced.append(Path(f"/proc/self/fd/{number}").resolve()))
    write_text(tmp_path / "file.txt", "whole")
    assert (tmp_path / "file.txt").read_text() == "whole"
    file, folder = synced
    assert file.parent == folder == tmp_path


def test_a_run_knows_the_machine_of_each_of_its_rows_and_is_refused_without_it(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    (path,) = (clean_race.copied(tmp_path / "run").path / "machines").iterdir()
    described = json.loads(text := path.read_text())
    path.write_text(text.replace('"cores": ', '"cores": 1'))
    assert f"{path}: does not match the digest in its name" in piezobench("report", tmp_path / "run").refusal
    path.unlink()
    another = described | {"cores": 1000}
    path.with_name(f"{machine.key(another)}.json").write_text(json.dumps(another))
    assert f"machines has no {path.stem}.json" in piezobench("report", tmp_path / "run").refusal
