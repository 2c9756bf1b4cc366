"""However a live run ends: exit status and sentence, where the stage is, its recording, and that no process is left."""

import os
import random
import resource
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest
from command_line import (
    LIVE,
    STAGES,
    CommandLine,
    free_port,
    spawned,
    wait_until,
    wait_until_gone,
    without_waiting,
)
from recording_files import text_file

from bench.live.session import stream_beside
from bench.timing import cores
from piezo_model import Recording
from piezo_model.recordings.formats.arrow import whole_batches

LIMIT, SLOPE = 150.0, 3_000.0
FAULTY = """{stage}
import pathlib, time
mark = pathlib.Path({mark!r})
class TcpStage(TcpStage):
    count, first = 0, not mark.exists()
    def {method}(self, *x):
        TcpStage.count += 1
        y = super().{method}(*x)
        if self.first and TcpStage.count >= {at}:
            mark.touch()
            {code}
        return y
"""
ASLEEP = "time.sleep(1e6)"
KEEPS_THE_INTERPRETER = "import ctypes; ctypes.PyDLL(None).sleep(1_000_000)"


class Stage:
    """A stage in a process of its own, which logs its drives."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        words = [sys.executable, str(STAGES / "tcp_server.py"), "0", str(folder / "drive.log")]
        self.server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        port = self.server.stdout.readline().split()[1]
        self.text = (
            (STAGES / "tcp_stage.py")
            .read_text()
            .replace("127.0.0.1:7654", f"127.0.0.1:{port}")
            .replace("timeout_s = 0.5", "timeout_s = 3.0")  # patient, since other tests may keep the machine busy
        )
        self.file = text_file(folder, self.text, name="stage.py")

    def faulty(self, method: str, code: str, at: int = 1) -> tuple[Path, Path]:
        """File of a stage that fails from that call of a method on, in the first process that opens it; and the file
        that says that it did."""
        mark = self.folder / "failed"
        text = FAULTY.format(stage=self.text, mark=str(mark), method=method, at=at, code=code)
        return text_file(self.folder, text, name="faulty.py"), mark

    def drives(self) -> np.ndarray:
        """Drives so far."""
        text = (self.folder / "drive.log").read_text()
        return np.array([float(line.split()[1]) for line in text[: text.rfind("\n") + 1].splitlines()])

    def close(self) -> None:
        with self.server as server:
            server.kill()


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    with closing(Stage(tmp_path)) as made:
        yield made


@dataclass(frozen=True)
class Live:
    """A running live run."""

    session: int
    stage: Stage
    port: int

    @property
    def children(self) -> list[int]:
        """The loop and, once it has been started, the process that stands by."""
        return spawned(self.session)

    def kill(self, *which: int) -> None:
        """Kill the run's own process (0), its loop (1) or the process that stands by (2), at once."""
        all_of_them = (self.session, *self.children)
        for number in which:
            os.kill(all_of_them[number], signal.SIGKILL)

    def signal(self, *numbers: signal.Signals) -> None:
        """Send signals to the run's own process, a hundredth of a second apart."""
        for number in numbers:
            os.kill(self.session, number)
            time.sleep(0.01)

    def fill_disk(self) -> None:
        """Let no file of the run grow any further."""
        wait_until((self.stage.folder / "run.arrow").exists)
        size = max(4096, (self.stage.folder / "run.arrow").stat().st_size)  # what it says is shorter
        resource.prlimit(self.session, resource.RLIMIT_FSIZE, (size, size))

    def close_tab(self) -> None:
        """Open the page and close it before it has come."""
        with socket.create_connection(("127.0.0.1", self.port)) as tab:
            tab.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            tab.sendall(b"GET /guess HTTP/1.1\r\n\r\n")


@dataclass(frozen=True)
class End:
    """An end of a run: its cause, and what it promises."""

    status: int
    says: str
    """Part of what it says."""
    fault: str = ""
    """Code that the stage runs after a call of its ``method``, from a drawn call on."""
    method: str = "exchange"
    act: Callable[[Live], object] | None = None
    """What happens to the run at a drawn time, or after the fault."""
    words: tuple[object, ...] = ()
    at_rest: bool = True
    begins: bool | None = True
    """Whether the stage is driven at all; None for either."""
    parent_lives: bool = True


RESCUED = "another process has brought the stage to rest."
STOPPED = "The stage is at rest; asked to stop."
SILENT = f"The stage did not answer for 3 s; {RESCUED}"
ENDS = {
    "SIGINT": End(130, STOPPED, act=lambda run: run.signal(signal.SIGINT)),
    "SIGTERM": End(143, STOPPED, act=lambda run: run.signal(signal.SIGTERM)),
    "SIGHUP": End(129, STOPPED, act=lambda run: run.signal(signal.SIGHUP)),
    "SIGINT twice": End(130, STOPPED, act=lambda run: run.signal(signal.SIGINT, signal.SIGINT)),
    "SIGTERM and SIGHUP": End(143, STOPPED, act=lambda run: run.signal(signal.SIGTERM, signal.SIGHUP)),
    "interrupted loop": End(0, STOPPED, act=lambda run: os.kill(run.children[0], signal.SIGINT)),
    "stopped loop": End(
        0, "rest; the time is over", act=lambda run: os.kill(run.children[0], signal.SIGSTOP), words=("--seconds", 3)
    ),
    "killed loop": End(1, f"The loop's process died; {RESCUED}", act=lambda run: run.kill(1)),
    "killed parent": End(-9, "", act=lambda run: run.kill(0), parent_lives=False),
    "killed parent and helper": End(-9, "", act=lambda run: run.kill(0, 2), parent_lives=False),
    "killed helper": End(
        1, "The stage is at rest; the process that stood by to bring it to rest died.", act=lambda run: run.kill(2)
    ),
    "all killed": End(-9, "", act=lambda run: run.kill(0, 2, 1), parent_lives=False, at_rest=False),
    "loop and helper killed": End(
        1,
        "could not be brought to rest (the second process died): its last drive was",
        act=lambda run: run.kill(2, 1),
        at_rest=False,
    ),
    "hangs": End(1, SILENT, ASLEEP),
    "hangs in compiled code": End(1, SILENT, KEEPS_THE_INTERPRETER),
    "hangs and is interrupted": End(130, SILENT, ASLEEP, act=lambda run: run.signal(signal.SIGINT)),
    "hangs and its parent is killed": End(-9, "", ASLEEP, act=lambda run: run.kill(0), parent_lives=False),
    "hangs and all others are killed": End(
        -9, "", ASLEEP, act=lambda run: run.kill(0, 2), parent_lives=False, at_rest=False
    ),
    "raises": End(1, "the amplifier is gone", "raise OSError('the amplifier is gone')"),
    "exits": End(1, "the driver gives up", "raise SystemExit('the driver gives up')"),
    "dies": End(1, f"The loop's process died; {RESCUED}", "os._exit(0)"),
    "no number": End(1, "it returned 'far' and no number", "return 'far'"),
    "NaN": End(1, "The stage is at rest; no measurement for 3 s.", "return float('nan')"),
    "slow": End(0, "The stage is at rest; the time is over.", "time.sleep(0.02)", words=("--seconds", 2)),
    "goes away": End(1, "could not be brought to rest (", act=lambda run: run.stage.close(), at_rest=False),
    "does not open": End(
        2, "it cannot be opened: the port is taken", "raise OSError('the port is taken')", "open", begins=False
    ),
    "interrupted while it opens": End(130, "", ASLEEP, "open", lambda run: run.signal(signal.SIGINT), begins=False),
    "does not close": End(
        1,
        "at rest; the time is over; it cannot be closed: gone.",
        "raise OSError('gone')",
        "close",
        words=("--seconds", 1),
    ),
    "never closes": End(
        1, "The stage is at rest; the stage did not close within 10 s.", ASLEEP, "close", words=("--seconds", 1)
    ),
    "closed tab": End(130, STOPPED, act=lambda run: (run.close_tab(), run.signal(signal.SIGINT))),
    "full disk": End(1, "could not be written: ", act=lambda run: run.fill_disk()),
    "Ctrl-C while it starts": End(130, "", act=lambda run: os.killpg(run.session, signal.SIGINT), begins=None),
    "time": End(0, "The stage is at rest; the time is over.", words=("--seconds", 1)),
    "page's port taken": End(2, "cannot serve the page at 127.0.0.1:", begins=False),
    "recording exists": End(2, "run.parquet: is a recording; move it away", begins=False),
    "stream exists": End(2, "run.arrow: was left by an unfinished run; move it away", begins=False),
    "damaged model": End(2, "model.json: ", words=("model.json",), begins=False),
    "wrong stage": End(2, "cannot be run: SyntaxError", "'", begins=False),
}


def drawn() -> list[tuple[str, int]]:
    """Each kind of end, a hang in the first exchange at the front, with the seed of its circumstances."""
    kinds = random.Random(0).sample([*ENDS], k=len(ENDS))
    return [("hangs", -1), *((kind, seed) for seed, kind in enumerate(kinds))]


def recorded(path: Path, column: str = "drive_V") -> np.ndarray:
    """The drives, or another column, that were recorded: in the file, or in the stream beside it, whose run may have
    been killed before its first batch, or before there was a stream."""
    stream = stream_beside(path)
    rest = whole_batches(stream) if stream.exists() else ()
    batches = parquet.read_table(path).to_batches() if path.exists() else rest
    return np.concatenate([np.empty(0), *(batch[column].to_numpy() for batch in batches)])


@pytest.mark.sample(2)
@pytest.mark.parametrize(("kind", "seed"), drawn())
def test_however_and_whenever_a_run_ends_it_keeps_what_it_promises(
    kind: str, seed: int, stage: Stage, piezobench: CommandLine, tmp_path: Path
) -> None:
    """In circumstances that the seed draws."""
    end, chance, record, port = ENDS[kind], random.Random(f"{kind} {seed}"), tmp_path / "run.parquet", free_port()
    rate = chance.choice((10, 100, 500, 2000))
    before = 1 if seed < 0 or chance.random() < 0.3 else chance.randrange(rate // 2, rate)
    file, mark = (
        (stage.file, None)
        if not end.fault
        else stage.faulty(end.method, end.fault, before if end.method == "exchange" else 1)
    )
    (tmp_path / "model.json").write_text("{")
    precious = {"recording exists": record, "stream exists": stream_beside(record)}.get(kind)
    if precious:
        precious.write_text("precious")
    words = (*end.words, "--device", file, "--sine", "2Hz:12um", "--rate", rate, "--port", port, "--record", record)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        if kind == "page's port taken":
            words = (*words, "--port", taken.getsockname()[1])
        call = piezobench.start("live", *words, folder=tmp_path)
        run, drives = Live(call.pid, stage, port), 0
        if end.act is not None:
            wait_until(mark.exists if mark else lambda: stage.drives().size >= before if end.begins else run.children)
            time.sleep(0.0 if end.begins else chance.uniform(0.0, 2.0))
            drives = stage.drives().size
            end.act(run)
        ended = call.wait()
    wait_until_gone(call.pid)
    said = " ".join((ended.stderr if ended.status == 2 else ended.stdout).split())
    assert (ended.status, end.says in said) == (end.status, True), ended
    assert ended.stderr.count("\n") == (ended.status == 2), ended.stderr
    x = np.concatenate([[0.0], stage.drives()])
    assert end.begins in (x.size > 1, None)
    assert 0.0 <= x.min() <= x.max() <= LIMIT
    assert np.abs(np.diff(x)).max(initial=0.0) <= SLOPE / rate * (1.0 + 1e-9)
    assert x[-1] == 0.0 or not end.at_rest
    if end.begins:
        y = recorded(record)
        lost = 1.5 * rate if not end.parent_lives else 1.5 * rate if kind == "full disk" else 3
        assert (drives if not end.parent_lives else x.size - 1) - y.size <= lost
        np.testing.assert_array_equal(y[: before - 1], x[1 : y.size + 1][: before - 1])
    elif precious:
        assert precious.read_text() == "precious"
    elif end.begins is False:
        assert not list(tmp_path.glob("run.*"))
    else:
        assert recorded(record).size < x.size
    # a recording needs two rows; a stall of ten periods begins a part, and a part of fewer than 16 rows is refused
    if kind == "full disk" and y.size > 1:
        rows = int(np.argmax(np.diff(recorded(record, "time_s"), append=np.inf) > 9.0 / rate)) + 1
        options = {"to_s": (rows - 0.5) / rate, "resample": 1.0 / rate, "time_unit": "s"}
        assert (
            rows == 1
            or Recording.open(stream_beside(record), "time_s", "drive_V", "displacement_um", **options).length >= rows
        )


@pytest.mark.slow
def test_a_run_that_is_killed_while_it_waits_for_a_core_never_touches_the_stage(
    stage: Stage, piezobench: CommandLine
) -> None:
    with ExitStack() as held:
        for _ in cores.usable():
            held.enter_context(cores.claim())
        call = piezobench.start("live", "--device", stage.file, "--seconds", 1, "--no-page")
        wait_until(lambda: "waiting for a core: other measurements occupy all of them" in call.stderr.read_text())
        call.kill()
        call.wait()
    wait_until_gone(call.pid)
    assert not stage.drives().size


@pytest.mark.slow
def test_a_run_whose_output_nobody_reads_ends_at_rest_with_its_recording(stage: Stage, tmp_path: Path) -> None:
    words = ("--device", stage.file, "--rate", "100", "--seconds", "2", "--record", tmp_path / "run.parquet")
    with subprocess.Popen(
        [*LIVE, *words, "--port", str(free_port())], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as call:
        assert call.stdout.readline().startswith("Page: ")
        call.stdout.close()
        errors = without_waiting(call.stderr.read())
    assert (call.returncode, errors) == (2, "piezobench live: standard output cannot be written (Broken pipe)\n")
    assert stage.drives()[-1] == 0.0
    np.testing.assert_array_equal(recorded(tmp_path / "run.parquet"), stage.drives())


@pytest.mark.nightly
def test_a_stage_that_does_not_open_within_a_minute_is_refused(stage: Stage, piezobench: CommandLine) -> None:
    file, _ = stage.faulty("open", ASLEEP)
    assert piezobench("live", "--device", file, "--no-page").refusal == (
        f"piezobench live: {file}: did not open within 60 s"
    )


@pytest.mark.slow
def test_a_compensator_that_fails_does_not_keep_the_stage_from_rest(stage: Stage, tmp_path: Path) -> None:
    script = tmp_path / "run.py"
    script.write_text(
        "import piezo_model\nfrom bench.cli.app import run\n"
        "class Fails(piezo_model.SelfLearningCompensator):\n    def step(self, y_ref, y): 1 / 0\n"
        "import bench.live.settings\nbench.live.settings.SelfLearningCompensator = Fails\n"
        "if __name__ == '__main__': raise SystemExit(run("
        f"['live', '--device', {str(stage.file)!r}, '--no-page', '--rate', '100']))\n"
    )
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert ended.returncode == 1, ended.stderr
    assert "The stage is at rest; the loop failed: division by zero." in ended.stdout
    assert stage.drives()[-1] == 0.0
