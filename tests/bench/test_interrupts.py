"""Ctrl-C ends the program with status 130 and without a traceback, whatever it is doing."""

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
from command_line import CommandLine, wait_until_gone
from conftest import Race

from piezo_model import Recording, identify, plants
from piezo_model.recordings.writer import write_table


@pytest.mark.parametrize("verb", ["race", "identify", "report"])
def test_an_interrupt_while_libraries_are_imported_ends_the_program_in_silence(tmp_path: Path, verb: str) -> None:
    chance = random.Random(verb)
    for _ in range(2):
        call = subprocess.Popen([sys.executable, "-X", "importtime", "-m", "bench", verb, str(tmp_path / "none"), "--out", str(tmp_path / "o")],
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert call.stderr is not None
        while "typer" not in call.stderr.readline():  # which the program imports first
            assert call.poll() is None
        time.sleep(chance.uniform(0.0, 0.3))
        call.send_signal(signal.SIGINT)
        _, said = call.communicate()
        assert "Traceback" not in said
        assert call.returncode in (130, 2)  # or it had found already that there is no such file


def test_an_interrupted_race_says_how_to_carry_on(tmp_path: Path) -> None:
    words = ("race", "--set", "paper", "--limit", "1", "--solver", "daqp", "--lane", "direct", "--out", str(tmp_path), "--name", "run")
    call = subprocess.Popen([sys.executable, "-m", "bench", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not (tmp_path / "run" / "run.json").is_file():
        assert call.poll() is None
        time.sleep(0.01)
    call.send_signal(signal.SIGINT)
    shown, said = call.communicate()
    assert call.returncode == 130, said
    assert (shown, said.splitlines()) == ("", [f"Interrupted; what is done is kept, and 'piezobench resume {tmp_path / 'run'}' carries on."])


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def words_of(verb: str, folder: Path) -> tuple[object, ...]:
    """A call that writes into a folder; the model lies beside it."""
    model = folder.parent / "model.json"
    return {"report": ("report", folder / "run"), "export-c": ("export-c", model, folder / "c"),
            "export-fmu": ("export-fmu", model, folder / "stage.fmu"),
            "identify": ("identify", folder.parent / "stage.csv", "--out", folder / "model.json", "--page", folder / "page.html")}[verb]


@pytest.mark.nightly
@pytest.mark.parametrize("verb", ["report", "export-c", pytest.param("export-fmu", marks=pytest.mark.needs("cc")), "identify"])
def test_a_call_ended_at_any_moment_by_any_signal_leaves_whole_files_and_no_process(
        piezobench: CommandLine, clean_race: Race, tmp_path: Path, verb: str) -> None:
    x = 5.0 + 4.0 * np.sin(np.arange(4000) / 200.0) * np.linspace(1.0, 0.5, 4000)
    model = identify(Recording.from_arrays(x, plants.get("dense_prandtl_ishlinskii", sample_time=1e-3).run(10.0 * x), 1e-3), n=3, m=1)
    model.save(tmp_path / "model.json")
    write_table(tmp_path / "stage.csv", {"time_s": np.arange(x.size) * 1e-3, "drive_V": x, "y_um": model.simulate(x)})
    chance, whole, took = random.Random(verb), {}, 0.0
    for number in range(25):
        folder = tmp_path / str(number)
        folder.mkdir()
        if verb == "report":
            shutil.copytree(clean_race.run.path, folder / "run")
        before, begin = tree(folder), time.monotonic()
        call = piezobench.start(*words_of(verb, folder))
        if number > 2:  # the first three are left alone
            time.sleep(chance.uniform(0.0, took))
            os.kill(call.pid, (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)[number % 3])
        ended = call.wait()
        wait_until_gone(call.pid)
        if number <= 2:
            assert ended.status == 0, ended.stderr
            whole, took = tree(folder), time.monotonic() - begin
            continue
        assert ended.status in (0, 130, -signal.SIGKILL, -signal.SIGTERM), ended.stderr
        assert "Traceback" not in ended.stderr
        found = {name: data for name, data in tree(folder).items() if not any(part.startswith(".") for part in Path(name).parts)}
        assert found.keys() <= whole.keys()
        for name, data in found.items():
            assert len(data) in (len(whole[name]), len(before.get(name, b"-"))) or (name.endswith((".html", ".svg")) and data.rstrip().endswith(b">"))
        again = piezobench(*words_of(verb, folder))  # nothing that was left is in the way
        assert again.status == 0 or "already" in again.stderr, again.stderr
        assert tree(folder).keys() >= whole.keys()
