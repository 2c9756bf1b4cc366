"""A file that makes its parser crash, hang or run out of memory affects a child process only."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import unruly_format
from recording_files import signals

from piezo_model.recordings import Recording, RecordingError, isolated
from piezo_model.recordings.options import ReadOptions


def refusal_of(path: Path, what: str) -> str:
    path.write_text(what)
    with pytest.raises(RecordingError) as caught:
        isolated.open_isolated(unruly_format.read, path, ReadOptions())
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("crash", "is damaged, the process that read it ended with SIGSEGV"),
        ("exit", "is damaged, the process that read it ended with exit status 3, after printing 'goodbye'"),
        ("eat", "takes more than 4096 MB to be read"),
    ],
)
def test_a_file_that_ends_the_process_that_reads_it_is_refused_and_the_next_one_read(
    tmp_path: Path, what: str, words: str
) -> None:
    assert words in refusal_of(tmp_path / "stage.rec", what)
    scipy.io.savemat(tmp_path / "stage.mat", signals())
    assert Recording.open(tmp_path / "stage.mat").length == 1000


def test_a_file_that_is_read_for_ever_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isolated, "LEAST_S", 1.5)
    assert "takes longer than 2 s to be read" in refusal_of(tmp_path / "stage.rec", "hang")


def test_of_a_large_file_only_the_arrays_that_are_wanted_are_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, read = tmp_path / "stage.rec", isolated.call
    path.write_text("well")
    small = isolated.open_isolated(unruly_format.read, path, ReadOptions())
    monkeypatch.setattr(isolated, "call", lambda *given, **named: read(*given, **named, at_once=1))
    large = isolated.open_isolated(unruly_format.read, path, ReadOptions())
    assert large.columns == small.columns
    np.testing.assert_array_equal(large.read([1]), [np.arange(100.0)[::-1]])
    path.write_text("crash")
    with pytest.raises(RecordingError, match="ended with SIGSEGV"):
        large.read([0])


def test_a_recording_that_was_read_does_not_change_with_its_file(tmp_path: Path) -> None:
    path = tmp_path / "stage.mat"
    scipy.io.savemat(path, signals())
    recording = Recording.open(path)
    path.write_bytes(b"MATLAB 5.0 nothing")
    np.testing.assert_array_equal(recording.x, signals()["voltage_V"])
    with pytest.raises(RecordingError, match="damaged"):
        Recording.open(path)


def test_a_script_without_a_guard_reads_such_files_and_leaves_no_process(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "stage.mat", signals())
    (tmp_path / "script.py").write_text(
        "import os\nfrom piezo_model import Recording\nfrom piezo_model.recordings import isolated\n"
        "print(Recording.open('stage.mat').length, isolated._child(os.getpid())._process.pid)\n"
    )
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    length, child = map(int, done.stdout.split())
    assert length == 1000
    assert not Path(f"/proc/{child}").exists()


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGKILL])
def test_a_child_that_is_busy_ends_with_its_parent_however_that_ends(tmp_path: Path, ending: signal.Signals) -> None:
    (tmp_path / "stage.rec").write_text("hang")
    program = (
        "import sys; from pathlib import Path; import unruly_format; "
        "from piezo_model.recordings.isolated import open_isolated; "
        "open_isolated(unruly_format.read, Path('stage.rec'), None)"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    busy = tmp_path / "busy"
    until(busy.exists)
    child = Path("/proc") / busy.read_text()
    assert child.exists()
    parent.send_signal(ending)
    parent.wait()
    until(lambda: not child.exists() or "zombie" in (child / "status").read_text())


def until(true: object, patience_s: float = 60.0) -> None:
    end = time.monotonic() + patience_s
    while not true():  # type: ignore[operator]
        assert time.monotonic() < end
        time.sleep(0.01)
