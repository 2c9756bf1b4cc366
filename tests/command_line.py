"""Run the command line in processes of its own, without the cost of importing everything each time.

A server process imports the verbs once and forks for every call, a real process with arguments, folder, output and exit
status, which tests may kill.
"""

from __future__ import annotations

import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path

PATIENCE_S = 60.0
LIVE = (sys.executable, "-m", "bench", "live")
STAGES = Path(__file__).parents[1] / "examples" / "live"
"""Files of stages."""
SERVER = """
import gc, json, os, resource, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # the tests themselves may run in the background
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # or under nohup
from bench.cli import prepare_streams
from bench.cli.app import command_line, run
from bench.problems import make
command_line()  # imports every verb
next(make("paper").problems())  # loads modules that load at first use
run(["problems", "--set", "none"])  # and those that read words
import pint, pyarrow.pandas_compat
gc.freeze()
while line := sys.stdin.readline():
    call = json.loads(line)
    child = os.fork()
    if not child:
        os.setsid()
        print(os.getpid(), flush=True)
        for number, path in enumerate((os.devnull, call["stdout"], call["stderr"])):
            os.dup2(os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND), number)
        for stream in (sys.stdout, sys.stderr):
            stream.reconfigure(encoding=call["encoding"])
        prepare_streams()
        os.environ.update(call["environment"])
        os.chdir(call["folder"])
        if call["largest_file"]:
            resource.setrlimit(resource.RLIMIT_FSIZE, (call["largest_file"],) * 2)
        status = run(call["words"])
        sys.stdout.flush()
        os._exit(status)  # an orderly shutdown costs a second
    sys.stdin.readline()  # until then the child stays a zombie and keeps its number
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def python(
    *words: object, folder: Path | None = None, first: object = "", status: int | None = 0, **environment: str
) -> subprocess.CompletedProcess[str]:
    """A process of Python with the paths of this one after the ``first``; it must end with a status, if one is
    given."""
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(first)] * bool(first) + sys.path), **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert status in (None, done.returncode), (done.stdout, done.stderr)
    return done


def run_example(script: str, *words: object) -> str:
    """Output of a script of ``examples/``, which must succeed."""
    done = python(STAGES.parent / script, *words, PYTHONPATH=str(STAGES.parents[1]))
    assert without_waiting(done.stderr) == ""
    return done.stdout


def hears_its_terminal() -> None:
    """In a child: SIGINT and SIGHUP end it, though the tests themselves may run in the background or under nohup."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def without_waiting(stderr: str) -> str:
    """What a call said, but that it waited for a core, which depends on the tests beside it."""
    return re.sub(r"^waiting for a core: other measurements occupy all of them\n", "", stderr, flags=re.MULTILINE)


@dataclass(frozen=True)
class Finished:
    """Result of a call."""

    status: int
    stdout: str
    stderr: str

    @property
    def said(self) -> str:
        """What it printed, on one line."""
        return " ".join(self.stdout.split())

    @property
    def refusal(self) -> str:
        """The one sentence with which a call was refused."""
        lines = self.stderr.splitlines()
        assert self.status == 2, (self.status, self.stderr)
        assert len(lines) == 1, self.stderr
        assert lines[0].startswith("piezobench"), lines[0]
        return lines[0]


def in_process(*words: object, folder: Path | None = None) -> Finished:
    """The result of a call in this process, whose server of further processes all such calls share."""
    from bench.cli.app import run  # which needs packages that the tests of the paper do without

    with chdir(folder or Path()), redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as error:
        status = run([str(word) for word in words])
    return Finished(status, out.getvalue(), without_waiting(error.getvalue()))


class Call:
    """A running call."""

    def __init__(self, server: CommandLine, pid: int, stdout: Path, stderr: Path, encoding: str) -> None:
        self.server, self.pid, self.stdout, self.stderr, self.encoding = server, pid, stdout, stderr, encoding

    def kill(self) -> None:
        """``kill -9``; harmless after the end, since the process stays a zombie until :meth:`wait`."""
        os.kill(self.pid, 9)

    def kill_once(self, reached: Callable[[], bool], number: signal.Signals = signal.SIGKILL) -> Finished:
        """Signal it once a condition holds, unless it ends before, and wait for every process of its session."""
        while of_session(self.pid) and not reached():
            time.sleep(0.002)
        os.kill(self.pid, number)
        ended = self.wait()
        wait_until_gone(self.pid)
        return ended

    def wait(self) -> Finished:
        """Wait for the end."""
        self.server.ask("")
        self.server.running_call = None
        status = int(self.server.answer())
        return Finished(
            status, self.stdout.read_text(self.encoding), without_waiting(self.stderr.read_text(self.encoding))
        )


def of_session(leader: int) -> list[int]:
    """Running processes of a session."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):  # ended meanwhile
            continue
        if int(fields[3]) == leader and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def command_lines(pids: Iterable[int]) -> list[str]:
    """Command lines of those processes that still run."""
    found = []
    for pid in pids:
        with suppress(FileNotFoundError, ProcessLookupError):
            found.append(Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode())
    return found


def spawned(session: int) -> list[int]:
    """Processes of multiprocessing in a session, in the order of their start."""
    return sorted(pid for pid in of_session(session) if "spawn_main" in "".join(command_lines([pid])))


def pacing(session: int) -> list[str]:
    """Command lines of the C program of ``realtime`` in a session."""
    return [words for words in command_lines(of_session(session)) if words.startswith("./loop ")]


def free_port() -> int:
    """A port of this machine that nobody uses, below those that the system itself gives to connections."""
    while True:
        port = 10_000 + int.from_bytes(os.urandom(4), "little") % 22_768
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port


def contents(folder: Path) -> dict[str, bytes]:
    """Every file and folder below a folder but Python's caches, with what a file holds."""
    paths = (path for path in folder.rglob("*") if "__pycache__" not in path.parts)
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b"" for path in paths}


def kill_worker(call: Call, reached: Callable[[], bool]) -> Finished:
    """Kill one of the local workers of a call once a condition holds, and wait for every process of its session."""
    wait_until(lambda: len(spawned(call.pid)) >= 2 and reached(), lambda: command_lines(of_session(call.pid)))
    os.kill(spawned(call.pid)[-1], signal.SIGKILL)
    ended = call.wait()
    wait_until_gone(call.pid)
    return ended


class CommandLine:
    """``piezobench``; used as a function."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.calls = folder, 0
        self.running_call: Call | None = None
        self.log = (folder / "server.log").open("w")
        self.server = subprocess.Popen(
            [sys.executable, "-c", SERVER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.log,
            text=True,
            env={**os.environ, "TMPDIR": str(folder)},
        )

    def ask(self, line: str) -> None:
        """Send a line to the server."""
        self.server.stdin.write(line + "\n")
        self.server.stdin.flush()

    def answer(self) -> str:
        """Read the next line of the server."""
        line = self.server.stdout.readline()
        assert line, Path(self.log.name).read_text()
        return line

    def start(
        self,
        *words: object,
        folder: Path | None = None,
        largest_file: int = 0,
        encoding: str = "utf-8",
        **environment: str,
    ) -> Call:
        """Start a call with an encoding of its output; only one call runs at a time."""
        self.end_call()
        self.calls += 1
        stdout, stderr = (self.folder / f"call{self.calls}.{name}" for name in ("stdout", "stderr"))
        for path in (stdout, stderr):
            path.touch()  # the process may be killed before it opens them
        call: Mapping[str, object] = {
            "words": [str(word) for word in words],
            "stdout": str(stdout),
            "stderr": str(stderr),
            "folder": str(folder or self.folder),
            "largest_file": largest_file,
            "encoding": encoding,
            "environment": environment,
        }
        self.ask(json.dumps(call))
        self.running_call = Call(self, int(self.answer()), stdout, stderr, encoding)
        return self.running_call

    def end_call(self) -> None:
        """Kill a call that a failed test left running."""
        if self.running_call is not None:
            self.running_call.kill()
            self.running_call.wait()

    def __call__(
        self,
        *words: object,
        folder: Path | None = None,
        largest_file: int = 0,
        encoding: str = "utf-8",
        **environment: str,
    ) -> Finished:
        """Run a call to its end."""
        return self.start(*words, folder=folder, largest_file=largest_file, encoding=encoding, **environment).wait()

    def run(self, *words: object, folder: Path | None = None, encoding: str = "utf-8") -> Finished:
        """Run a call to its end, which must be a success."""
        done = self(*words, folder=folder, encoding=encoding)
        assert done.status == 0, (words, done.stdout, done.stderr)
        return done

    def quietly(self, *words: object, folder: Path | None = None) -> Finished:
        """Run a call to its end, which must be a success without a warning."""
        done = self.run(*words, folder=folder)
        assert done.stderr == "", words
        return done

    def close(self) -> None:
        """Stop the server."""
        self.end_call()
        self.server.stdin.close()
        self.server.wait()
        self.server.stdout.close()
        self.log.close()


def wait_until(condition: Callable[[], object], details: Callable[[], object] = lambda: "") -> None:
    """Wait until a condition holds; after a minute the test fails, with details."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, details()
        time.sleep(0.05)


def wait_until_gone(leader: int) -> None:
    """Wait until every process of a session has ended."""
    wait_until(lambda: not of_session(leader), lambda: f"processes {of_session(leader)} outlive the race")
