"""Ctrl-C, SIGTERM and SIGHUP end the program without a traceback and leave nothing, whatever it is doing."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command_line import (
    CommandLine,
    contents,
    hears_its_terminal,
    pacing,
    wait_until,
    wait_until_gone,
    without_waiting,
)
from exported_loops import a_model
from small_races import TWO_CORES, Race, saved

from bench.store import Run
from piezo_model import Recording, identify, plants
from piezo_model.recordings.writer import write_table


@pytest.mark.parametrize("verb", ["race", "identify", "report"])
def test_an_interrupt_while_libraries_are_imported_ends_the_program_in_silence(tmp_path: Path, verb: str) -> None:
    chance = random.Random(verb)
    for _ in range(2):
        call = subprocess.Popen(
            [
                sys.executable,
                "-X",
                "importtime",
                "-m",
                "bench",
                verb,
                str(tmp_path / "none"),
                "--out",
                str(tmp_path / "o"),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=hears_its_terminal,
        )
        while "typer" not in call.stderr.readline():  # the first import of the program
            assert call.poll() is None
        time.sleep(chance.uniform(0.0, 0.3))
        call.send_signal(signal.SIGINT)
        _, output = call.communicate()
        assert "Traceback" not in output
        assert call.returncode in (130, 2)  # or it had already found that the file is missing


@pytest.mark.slow
def test_a_folder_for_temporary_files_whose_name_is_too_long_is_named(tmp_path: Path) -> None:
    temporary = tmp_path / ("t" * 90)
    temporary.mkdir()
    call = subprocess.run(
        [sys.executable, "-m", "bench", "race", "--solver", "daqp", "--out", str(tmp_path / "results")],
        check=False,
        env={**os.environ, "TMPDIR": str(temporary)},
        capture_output=True,
        text=True,
    )
    assert call.returncode == 2
    (output,) = call.stderr.splitlines()
    assert (
        f"{temporary} has too long a name for the sockets of the solvers' processes; set TMPDIR to another folder"
        in output
    )
    assert not (tmp_path / "results").exists()
    assert not list(temporary.iterdir())


FEW = ("--solver", "daqp", "--lane", "direct", "--out", "results", "--name", "run")
KINDS = {
    "problems": ("race", "--set", "paper", *FEW),
    "race": ("race", "--set", "paper", "--repeats", 9, *FEW),
    "workers": ("race", "--set", "paper", "--repeats", 9, *FEW, "--workers", 2),
    "realtime": ("realtime", "model.json", "--rate", 1000, "--seconds", 1000),
}
RESUMES = "Interrupted; finished tasks are kept; run 'piezobench resume results/run' to continue."


def is_at_work(kind: str, folder: Path, session: int) -> bool:
    """Whether a call has started its processes and files."""
    if kind == "realtime":
        return bool(pacing(session))
    run = folder / "results" / "run"
    return (run / "run.json").is_file() if kind == "problems" else bool(saved(Run(run)))


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("kind", "ending"),
    [
        ("problems", signal.SIGINT),
        ("race", signal.SIGINT),
        ("race", signal.SIGTERM),
        pytest.param("workers", signal.SIGHUP, marks=TWO_CORES),
        pytest.param("realtime", signal.SIGTERM, marks=pytest.mark.needs("cc")),
        pytest.param("realtime", signal.SIGHUP, marks=pytest.mark.needs("cc")),
    ],
    ids=str,
)
def test_a_signalled_call_removes_its_processes_and_its_temporary_files(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, kind: str, ending: signal.Signals
) -> None:
    a_model().save(tmp_path / "model.json")
    temporary = tmp_path_factory.mktemp("tmp")
    with subprocess.Popen(
        [sys.executable, "-m", "bench", *map(str, KINDS[kind])],
        cwd=tmp_path,
        start_new_session=True,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=hears_its_terminal,
    ) as call:
        wait_until(lambda: is_at_work(kind, tmp_path, call.pid), call.poll)
        call.send_signal(ending)
        shown, output = call.communicate()
    wait_until_gone(call.pid)
    assert call.returncode == 128 + ending
    assert shown == "" or kind not in ("problems", "race")
    assert without_waiting(output).strip() == ("" if kind == "realtime" else RESUMES)
    # a lock's file stays, free
    assert not [path.name for path in temporary.iterdir() if not path.name.endswith(".lock")]


LOST = """
import os, signal, time
from contextlib import contextmanager
from bench.cli import app

app.AGAIN_S = 0.2
signal.signal(signal.SIGTERM, app._interrupt)

@contextmanager
def tidied():
    try:
        yield
    finally:
        time.sleep(1.0)
        print("tidied", flush=True)

try:
    os.kill(os.getpid(), signal.SIGTERM)
except:  # as some libraries do while they are imported
    print("lost", flush=True)
try:
    with tidied():
        time.sleep(60.0)
        print("went on", flush=True)
except KeyboardInterrupt:
    print("arrived", flush=True)
"""


def test_an_interrupt_that_a_library_swallows_is_raised_again_and_does_not_cut_the_cleanup_short() -> None:
    done = subprocess.run([sys.executable, "-c", LOST], capture_output=True, text=True, check=False)
    assert (done.stdout.split(), done.stderr) == (["lost", "tidied", "arrived"], "")


@pytest.mark.slow
@pytest.mark.needs("cc")
@pytest.mark.parametrize("ignored", [signal.SIGHUP, signal.SIGINT], ids=str)
def test_a_call_started_with_nohup_or_in_the_background_continues_when_its_terminal_is_closed_or_interrupted(
    tmp_path: Path, ignored: signal.Signals
) -> None:
    a_model().save(tmp_path / "model.json")
    words = ("realtime", "model.json", "--rate", "1000", "--seconds", "2", "--out", "figures.json")
    with subprocess.Popen(
        [
            "sh",
            "-c",
            f"trap '' {ignored.name.removeprefix('SIG')}; exec \"$@\"",
            "sh",
            sys.executable,
            "-m",
            "bench",
            *words,
        ],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        start_new_session=True,
        text=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as call:
        wait_until(lambda: pacing(call.pid), call.poll)
        os.killpg(call.pid, ignored)  # as a terminal does, also to the C program
        call.communicate()
    assert call.returncode == 0
    assert (tmp_path / "figures.json").is_file()


def words_of(verb: str, folder: Path) -> tuple[object, ...]:
    """A call that writes into a folder, with a model beside it."""
    model = folder.parent / "model.json"
    return {
        "report": ("report", folder / "run"),
        "export-c": ("export-c", model, folder / "c"),
        "export-fmu": ("export-fmu", model, folder / "stage.fmu"),
        "identify": (
            "identify",
            folder.parent / "stage.csv",
            "--out",
            folder / "model.json",
            "--page",
            folder / "page.html",
        ),
    }[verb]


@pytest.mark.nightly
@pytest.mark.parametrize(
    "verb", ["report", "export-c", pytest.param("export-fmu", marks=pytest.mark.needs("cc")), "identify"]
)
def test_a_call_ended_at_any_moment_by_any_signal_leaves_whole_files_and_no_process(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path, verb: str
) -> None:
    x = 5.0 + 4.0 * np.sin(np.arange(4000) / 200.0) * np.linspace(1.0, 0.5, 4000)
    model = identify(
        Recording.from_arrays(x, plants.get("dense_prandtl_ishlinskii", sample_time=1e-3).run(10.0 * x), 1e-3), n=3, m=1
    )
    model.save(tmp_path / "model.json")
    write_table(tmp_path / "stage.csv", {"time_s": np.arange(x.size) * 1e-3, "drive_V": x, "y_um": model.simulate(x)})
    chance, whole, took = random.Random(verb), {}, 0.0
    for number in range(25):
        folder = tmp_path / str(number)
        folder.mkdir()
        if verb == "report":
            shutil.copytree(clean_race.run.path, folder / "run")
        before, begin = contents(folder), time.monotonic()
        call = piezobench.start(*words_of(verb, folder))
        if number > 2:  # the first three are left alone
            time.sleep(chance.uniform(0.0, took))
            os.kill(call.pid, (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)[number % 3])
        ended = call.wait()
        wait_until_gone(call.pid)
        if number <= 2:
            assert ended.status == 0, ended.stderr
            whole, took = contents(folder), time.monotonic() - begin
            continue
        assert ended.status in (0, 130, 143, -signal.SIGKILL, -signal.SIGTERM), ended.stderr
        assert "Traceback" not in ended.stderr
        found = {
            name: data
            for name, data in contents(folder).items()
            if not any(part.startswith(".") for part in Path(name).parts)
        }
        assert found.keys() <= whole.keys()
        for name, data in found.items():
            assert len(data) in (len(whole[name]), len(before.get(name, b"-"))) or (
                name.endswith((".html", ".svg")) and data.rstrip().endswith(b">")
            )
        again = piezobench(*words_of(verb, folder))  # nothing that was left is in the way
        assert again.status == 0 or "already" in again.stderr, again.stderr
        assert contents(folder).keys() >= whole.keys()
