"""The exported C on a schedule, and on an emulated controller."""

import json
import os
import resource
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, command_lines, of_session, wait_until, wait_until_gone
from exported_loops import DYNAMICS, a_model, compensation, learning, loop_of
from exported_programs import build, write_sources
from programs import program

from bench.export.building import EXACT, WARNINGS
from bench.export.realtime import real_time
from bench.export.settings import ExportError, ExportSettings
from bench.timing import cores
from piezo_model import Dynamics

LOOP = ExportSettings(part="learning", **loop_of("continuous"))
NOBODY = 65534


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("desk") / "model.json"
    a_model().save(path)
    return path


# The schedule.


@pytest.mark.needs("cc")
def test_the_times_of_a_run_are_shown_in_tables_and_given_as_json(
    piezobench: CommandLine, model_file: Path, tmp_path: Path
) -> None:
    words = ("realtime", model_file, "--rate", 2000, "--seconds", 0.3)
    shown = piezobench.run(*words, "--out", tmp_path / "figures.json")
    assert "of 600 deadlines at 2000 Hz missed; of a step that does nothing" in shown.stdout
    written = json.loads((tmp_path / "figures.json").read_text())
    for what, capability in (("memory", "locking memory"), ("fifo", "SCHED_FIFO"), ("core", "pinning to a core")):
        assert (written["allowed"][what] == "yes") == (f"Without {capability}" not in shown.stdout)
    learning = ("--part", "learning", "--priority", 0)
    printed = json.loads(piezobench(*words, *learning, "--json").stdout)
    assert printed["allowed"]["fifo"] == "not asked for"
    for figures in (written, printed):
        assert figures["samples"] == 600
        assert list(figures["histograms_us"]) == ["wake-up", "service", "response", "null response"]
        assert all(sum(counts.values()) == 600 for counts in figures["histograms_us"].values())
        for tail in figures["us"].values():
            assert tail["p50"] <= tail["p99"] <= tail["max"]
            assert tail["p99.99"] is None  # 600 samples cannot support it


@pytest.mark.needs("cc")
def test_the_program_waits_for_a_core_that_a_race_holds_and_then_holds_it_until_it_ends_or_is_killed(
    piezobench: CommandLine, model_file: Path
) -> None:
    words = ("realtime", model_file, "--rate", 100, "--seconds", 1000, "--priority", 0, "--core")
    with cores.claim() as core:
        call = piezobench.start(*words, core.number)
        waits = f"waiting for a free core: core {core.number} is held by process {os.getpid()} ("
        wait_until(lambda: call.stderr.read_text().startswith(waits))
        assert not pacing(call.pid)
    wait_until(lambda: pacing(call.pid))
    assert f" {core.number} times" in pacing(call.pid)[0]
    with socket.socket(socket.AF_UNIX) as other, pytest.raises(OSError, match="in use"):
        other.bind(f"\0piezobench-core{core.number}")
    call.kill()
    call.wait()
    wait_until_gone(call.pid)  # with the C program
    cores.claim(core.number).close()


def pacing(session: int) -> list[str]:
    """Command lines of the C program in a session."""
    return [words for words in command_lines(of_session(session)) if words.startswith("./loop ")]


@pytest.mark.slow
@pytest.mark.needs("cc")
def test_a_rate_that_no_step_can_hold_misses_deadlines() -> None:
    hurried = real_time(a_model(20, 9), LOOP, 1e6, 0.02).step
    assert hurried.missed > 0.9 * hurried.response_ns.size
    assert hurried.response_ns[-1] > hurried.response_ns[0]  # late ones are not left out: the delay adds up


def test_refusals_of_the_system_are_reported(tmp_path: Path) -> None:
    write_sources(tmp_path, a_model(), ExportSettings())
    subprocess.run([program("make"), "loop", f"CC={program('gcc')}"], cwd=tmp_path, capture_output=True, check=True)

    def without_rights() -> None:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
        resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))

    descriptor = os.open(tmp_path / "loop", os.O_RDONLY)  # the user that it runs as may have no access to the folder
    try:
        done = subprocess.run(
            [f"/proc/self/fd/{descriptor}", "1000", "0.05", "80", "4000", "/dev/null"],
            pass_fds=[descriptor],
            user=NOBODY if os.geteuid() == 0 else None,
            preexec_fn=without_rights,
            capture_output=True,
            text=True,
            check=True,
        )
    finally:
        os.close(descriptor)
    allowed = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert allowed["fifo"] == "Operation not permitted"
    assert allowed["memory"] != "yes"
    assert allowed["core"] == "Invalid argument"  # there is no core 4000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing.json"], "nothing.json: there is no such file"),
        (["model.json", "--rate", 0], "--rate"),
        (["model.json", "--seconds", "nan"], "--seconds"),
        (["model.json", "--rate", 1, "--seconds", 0.5], "0.5 s at 1 Hz hold no sample; the shortest run is 1 s"),
        (["model.json", "--solver", "box_active_set"], "--solver: is for --part learning"),
        (["model.json", "--priority", 100], "--priority"),
        (["model.json", "--core", -1], "--core"),
        (["model.json", "--out", "nowhere/figures.json"], "the folder nowhere does not exist"),
    ],
    ids=str,
)
def test_bad_input_is_refused_in_one_sentence(
    piezobench: CommandLine, model_file: Path, words: list[object], message: str
) -> None:
    assert message in piezobench("realtime", *words, folder=model_file.parent).refusal
    assert list(model_file.parent.iterdir()) == [model_file]


def test_a_missing_compiler_is_reported_with_the_package_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ExportError, match="there is no C compiler on this machine; on Debian, apt-get install gcc"):
        real_time(a_model(), ExportSettings(), 1000.0, 1.0)


# A controller.

ARM = (
    *("-O2", "-mthumb", "-mfloat-abi=hard", "-ffunction-sections", "-fdata-sections"),
    *("-nostartfiles", "--specs=nosys.specs", "-Wl,--gc-sections"),
)
CORES = {
    "Cortex-M4F": ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"),  # double precision in software
    "Cortex-M7": ("-mcpu=cortex-m7", "-mfpu=fpv5-d16"),
}


@pytest.mark.needs("arm-none-eabi-gcc", "qemu-arm")
@pytest.mark.parametrize(
    ("core", "solver", "dynamics"),
    [
        *((core, None, None) for core in CORES),
        ("Cortex-M7", None, DYNAMICS),
        *(
            pytest.param("Cortex-M7", solver, None, marks=pytest.mark.slow)
            for solver in ("projected_difference", "continuous")
        ),
    ],
)
def test_a_controller_computes_the_drives_of_python_and_learns_to_the_last_bit(
    tmp_path: Path, core: str, solver: str | None, dynamics: Dynamics | None
) -> None:
    expected = learning(solver, 24_000) if solver else compensation(8000, dynamics)
    write_sources(tmp_path, expected.model, expected.settings)
    image = build(tmp_path, "emulated.c", "arm-none-eabi-gcc", *WARNINGS, *EXACT, *ARM, *CORES[core])
    done = subprocess.run(
        [program("qemu-arm"), "-cpu", "max", image], input=expected.samples.tobytes(), capture_output=True, check=True
    )
    np.testing.assert_array_equal(np.frombuffer(done.stdout), expected.x)
    assert solver is None or expected.events[0] > 0  # weights were learned
