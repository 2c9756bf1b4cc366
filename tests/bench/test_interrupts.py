"""Ctrl-C, SIGTERM and SIGHUP end the program without a traceback and leave nothing, whatever it is doing."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import (
    hears_its_terminal,
    pacing,
    python,
    wait_until,
    wait_until_gone,
    without_waiting,
)
from exported_loops import a_model
from small_races import TWO_CORES, saved

from bench.store import Run


@pytest.mark.sample(2)
@pytest.mark.parametrize("draw", range(2))
@pytest.mark.parametrize("verb", ["race", "identify", "report"])
def test_an_interrupt_while_libraries_are_imported_ends_the_program_in_silence(
    tmp_path: Path, verb: str, draw: int
) -> None:
    call = subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "bench", verb, str(tmp_path / "none"), "--out", str(tmp_path / "o")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hears_its_terminal,
    )
    while "typer" not in call.stderr.readline():  # the first import of the program
        assert call.poll() is None
    time.sleep(random.Random(f"{verb} {draw}").uniform(0.0, 0.3))
    call.send_signal(signal.SIGINT)
    assert "Traceback" not in call.communicate()[1]
    assert call.returncode in (130, 2)  # or it had already found that the file is missing


@pytest.mark.slow
def test_a_folder_for_temporary_files_whose_name_is_too_long_is_named(tmp_path: Path) -> None:
    temporary = tmp_path / ("t" * 90)
    temporary.mkdir()
    words = ("-m", "bench", "race", "--solver", "daqp", "--out", tmp_path / "results")
    (output,) = python(*words, status=2, TMPDIR=str(temporary)).stderr.splitlines()
    assert (
        f"{temporary} has too long a name for the sockets of the solvers' processes; set TMPDIR to another folder"
    ) in output
    assert [*tmp_path.rglob("*")] == [temporary]


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


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("kind", "ending"),
    [
        ("problems", signal.SIGINT),
        ("race", signal.SIGTERM),
        ("race", signal.SIGINT),
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
    done = python("-c", LOST, status=None)
    assert (done.stdout.split(), done.stderr) == (["lost", "tidied", "arrived"], "")


@pytest.mark.slow
@pytest.mark.needs("cc")
@pytest.mark.parametrize("ignored", [signal.SIGHUP, signal.SIGINT], ids=str)
def test_a_call_started_with_nohup_or_in_the_background_continues_when_its_terminal_is_closed_or_interrupted(
    tmp_path: Path, ignored: signal.Signals
) -> None:
    a_model().save(tmp_path / "model.json")
    words = ("realtime", "model.json", "--rate", "1000", "--seconds", "2", "--json")
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
        figures, _ = call.communicate()
    assert call.returncode == 0
    assert json.loads(figures)["samples"] == 2000
