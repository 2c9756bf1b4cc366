"""Ctrl-C ends the program with status 130 and without a traceback, whatever it is doing."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest


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
