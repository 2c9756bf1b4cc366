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

from piezo_model.recordings import Recording, RecordingError, subprocess_reader
from piezo_model.recordings.tables import ReadOptions


def refusal_of(path: Path, what: str) -> str:
    path.write_text(what)
    with pytest.raises(RecordingError) as caught:
        subprocess_reader.open_table(unruly_format, path, ReadOptions())
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
    monkeypatch.setattr(subprocess_reader, "LEAST_S", 1.5)
    assert "takes longer than 2 s to be read" in refusal_of(tmp_path / "stage.rec", "hang")


def test_a_channel_that_crashes_when_its_rows_are_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "stage.rec").write_text("crash later")
    table = subprocess_reader.open_table(unruly_format, tmp_path / "stage.rec", ReadOptions())
    with pytest.raises(RecordingError, match="ended with SIGSEGV"):
        list(table.chunks([0]))


def test_a_file_that_was_changed_after_it_was_opened_is_read_as_it_was_listed_or_refused(tmp_path: Path) -> None:
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
        "import os\nfrom piezo_model import Recording\nfrom piezo_model.recordings import subprocess_reader\n"
        "print(Recording.open('stage.mat').length, subprocess_reader._child(os.getpid())._process.pid)\n"
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
        "from piezo_model.recordings.tables import ReadOptions; "
        "from piezo_model.recordings import subprocess_reader as reader; "
        "reader.open_table(unruly_format, Path('stage.rec'), ReadOptions())"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(unruly_format.__file__).parent)},
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
