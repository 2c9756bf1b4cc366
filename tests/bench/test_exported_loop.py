"""The exported controller at work. On a stage of one's own: however a run ends, the drive keeps its limits and comes to
rest. In two threads, step and learner: the same bits as in one thread if the learner is in time, and consistent weights
if it is late. On a schedule: the times of a run, its core, and what the system refuses."""

import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, hears_its_terminal, pacing, wait_until, wait_until_gone
from exported_loops import (
    DYNAMICS,
    LIMITS,
    LOOPS,
    Expected,
    a_model,
    build,
    compensation,
    learning,
    loop_of,
    write_sources,
)
from programs import program

from bench.export.building import EXACT, WARNINGS, write_files
from bench.export.c_source import export
from bench.export.realtime import real_time
from bench.export.settings import ExportError, ExportSettings
from bench.timing import cores
from piezo_model import Compensator, Dynamics, HysteresisCreepModel, ModelStructure

LOW, HIGH, REST, RATE_LIMIT, RATE = 20.0, 100.0, 40.0, 2000.0, 1000
STAGE = f"""
#define _GNU_SOURCE
#include "piezo_stage.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

const piezo_stage_limits piezo_stage = {{{LOW}, {HIGH}, {RATE_LIMIT}, {REST}}};
static FILE *drives;
static int samples;

int piezo_stage_open(void)
{{
    drives = fopen("drives.txt", "w");
    return drives == NULL;
}}

int piezo_stage_exchange(double x, double *y)
{{
    struct timespec t;
    if (++samples % 150 == 0) {{
        usleep(60000);
    }}
    clock_gettime(CLOCK_MONOTONIC, &t);
    fprintf(drives, "%.17g %.17g\\n", x, (double)t.tv_sec + 1e-9 * (double)t.tv_nsec);
    fflush(drives);
    *y = samples % 7 ? 0.2 * x - 15.0 : NAN;
    return samples == atoi(getenv("FAILING_SAMPLE"));
}}

void piezo_stage_close(void) {{ fclose(drives); }}
"""


def straight_line() -> HysteresisCreepModel:
    structure = ModelStructure.equidistant(
        n=5, m=3, x_range=(0.0, 150.0), y_range=(-20.0, 20.0), creep_rates=(1.0,), sample_time=1.0 / RATE
    )
    return HysteresisCreepModel.from_weights(structure, structure.straight_line)


def built(folder: Path, settings: ExportSettings, stage: str, piezo_step: str = "piezo_step") -> None:
    """Export a controller, whose step may have another name, to a folder and build the loop on a stage."""
    write_files(folder, export(straight_line(), settings))
    (folder / "piezo_stage.c").write_text(stage)
    (folder / "piezo.c").write_text((folder / "piezo.c").read_text().replace("piezo_step(", f"{piezo_step}("))
    done = subprocess.run([program("make"), "loop"], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")  # no warning


def learning_of(solver: str) -> ExportSettings:
    return ExportSettings(part="learning", **loop_of(solver))


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(ExportSettings(), id="compensator"),
        pytest.param(learning_of("continuous"), id="continuous"),
        pytest.param(learning_of("projected_difference"), id="projected_difference", marks=pytest.mark.slow),
    ],
)
def loop_folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A controller, or one of two learners, on the stage."""
    folder = tmp_path_factory.mktemp("loop")
    built(folder, request.param, STAGE)
    return folder


@pytest.mark.needs("cc", "make")
@pytest.mark.parametrize(
    ("end", "status"), [("time", 0), ("SIGHUP", 129), ("SIGINT", 130), ("SIGTERM", 143), ("stage", 1)]
)
def test_however_a_run_ends_the_drive_keeps_limits_and_rate_and_comes_to_rest(
    loop_folder: Path, tmp_path: Path, end: str, status: int
) -> None:
    seconds = "0.5" if end in ("time", "stage") else "60"
    run = subprocess.Popen(
        [loop_folder / "loop", str(RATE), seconds, "0", "-1", "times"],
        cwd=tmp_path,
        env={**os.environ, "FAILING_SAMPLE": "300" if end == "stage" else "0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=hears_its_terminal,
    )
    if end.startswith("SIG"):
        log = tmp_path / "drives.txt"
        while not (log.is_file() and log.stat().st_size > 2000):
            time.sleep(0.01)
        run.send_signal(signal.Signals[end])
    output = run.communicate(timeout=60)[1].decode()
    assert run.returncode == status, output
    assert ("the stage failed; its drive was brought to rest" in output) == (end == "stage")
    drives, moments = np.loadtxt(tmp_path / "drives.txt").T
    times = np.fromfile(tmp_path / "times", dtype=np.int64).reshape(-1, 2)
    assert LOW <= drives.min() <= drives.max() <= HIGH
    assert np.abs(np.diff(drives, prepend=REST)).max() <= RATE_LIMIT / RATE * (1 + 1e-12)
    assert drives[-1] == REST
    # after a late sample, too, which the stage makes at every 150th
    moved, lasted = np.abs(drives[30:] - drives[:-30]), moments[30:] - moments[:-30]
    assert np.all(moved <= RATE_LIMIT * (lasted + 1.5 / RATE))
    assert len(drives) >= len(times) == {"time": 500, "stage": 300}.get(end, len(times))


@pytest.mark.sample(1)
@pytest.mark.needs("cc", "make")
@pytest.mark.parametrize(
    ("limits", "sentence"),
    [
        ("{20.0, 100.0, 2000.0, 140.0}", "loop: piezo_stage needs low <= rest <= high and a rate limit above 0\n"),
        ("{20.0, 100.0, 0.0, 40.0}", "loop: piezo_stage needs low <= rest <= high and a rate limit above 0\n"),
        ("{20.0, 20.0, 2000.0, 20.0}", "loop: piezo_stage needs low < high\n"),
    ],
)
def test_limits_that_cannot_be_kept_are_refused_before_the_stage_is_opened(
    tmp_path: Path, limits: str, sentence: str
) -> None:
    built(tmp_path, ExportSettings(), STAGE.replace(f"{{{LOW}, {HIGH}, {RATE_LIMIT}, {REST}}}", limits))
    done = subprocess.run(
        ["./loop", str(RATE), "1", "0", "-1", "times"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (2, sentence)
    assert not (tmp_path / "drives.txt").exists()


STEPPED = """
#include "piezo.h"

piezo_real stepped(piezo_axis *axis, piezo_real y_ref);
piezo_real piezo_step(piezo_axis *axis, piezo_real y_ref)
{
    const piezo_real x = stepped(axis, y_ref);
    FILE *const steps = fopen("steps.txt", "a");
    fprintf(steps, "%.17g %.17g\\n", y_ref, x);
    fclose(steps);
    return x;
}
"""
"""Writes what an axis is asked and answers."""


@pytest.mark.needs("cc", "make")
@pytest.mark.parametrize("rate_limit", [RATE_LIMIT, 1e9])
def test_the_stage_gets_the_bits_of_its_axis_whose_integral_action_gets_the_output(
    tmp_path: Path, rate_limit: float
) -> None:
    stage = STAGE.replace(str(RATE_LIMIT), str(rate_limit)).replace("samples % 7 ?", "1 ?") + STEPPED
    built(tmp_path, ExportSettings(integral_gain=30.0), stage, piezo_step="stepped")
    subprocess.run(
        ["./loop", str(RATE), "0.5", "0", "-1", "times"],
        cwd=tmp_path,
        env={**os.environ, "FAILING_SAMPLE": "0"},
        check=True,
    )
    drives, (y_ref, x) = np.loadtxt(tmp_path / "drives.txt")[:500, 0], np.loadtxt(tmp_path / "steps.txt").T
    np.testing.assert_array_equal(drives, x)
    if rate_limit > RATE_LIMIT:  # the other one depends on the times of the run
        one = Compensator(straight_line(), x_limits=(LOW, HIGH), x_start=REST, integral_gain=30.0)
        for k, wanted in enumerate(y_ref):
            assert one.step(wanted) == x[k]
            one.correct(0.2 * x[k] - 15.0)


LEARNER = """#include "piezo_learner.c"

int offered(void *learner, double *inverse);
int offered(void *learner, double *inverse)
{
    const Learner l = learner_at(learner);
    memcpy(inverse, workspace_of(&l).inverse.w_H, (size_t)inverse_nums(l.shape) * sizeof(double));
    return (int)l.mailbox.head->offered;
}
"""
SIZE = 40_000
THREADED = ("projected_difference", "continuous")


@pytest.fixture(
    scope="module", params=[("-O2",), pytest.param(("-O1", "-g", "-fsanitize=thread"), marks=pytest.mark.slow)]
)
def threaded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Build the program of two threads for a solver, once."""

    @cache
    def built_for(solver: str) -> Path:
        folder, expected = tmp_path_factory.mktemp("two_threads"), learning(solver, SIZE)
        write_sources(folder, expected.model, expected.settings)
        shutil.copy(Path(__file__).with_name("two_threads.c"), folder)
        (folder / "offering_learner.c").write_text(LEARNER)
        words = [program("gcc"), "-D_POSIX_C_SOURCE=200809L", *WARNINGS, *EXACT, *request.param, "-pthread"]
        words += ["two_threads.c", "offering_learner.c", "-o", "two_threads", "-lm"]
        subprocess.run(words, cwd=folder, check=True)
        return folder / "two_threads"

    return built_for


def run_threaded(
    two_threads: Path, expected: Expected, delay: int = 0, seed: int = 0
) -> tuple[np.ndarray, dict[str, int]]:
    """Drives and counts of events; an error of the sanitizer ends the program with another status."""
    source, target = two_threads.with_suffix(".in"), two_threads.with_suffix(".out")
    expected.samples.tofile(source)
    done = subprocess.run(
        [two_threads, source, target, str(delay), str(seed)], capture_output=True, text=True, check=False, timeout=100
    )
    assert (done.returncode, done.stderr) == (0, "")
    names = ("hand_overs", "refusals", "late_offers", "dropped_blocks", "changes", "torn")
    return np.fromfile(target), dict(zip(names, map(int, done.stdout.split()), strict=True))


@pytest.mark.parametrize(
    "solver",
    [*THREADED, *(pytest.param(each, marks=pytest.mark.slow) for each in LOOPS if each not in THREADED)],
)
def test_a_learner_in_a_thread_of_its_own_that_is_in_time_changes_no_bit(
    threaded: Callable[[str], Path], solver: str
) -> None:
    expected = learning(solver, SIZE)
    x, events = run_threaded(threaded(solver), expected)
    np.testing.assert_array_equal(x, expected.x)
    assert (events["hand_overs"], events["refusals"]) == expected.events
    assert events["changes"] > 0
    assert events["late_offers"] == events["dropped_blocks"] == events["torn"] == 0


@pytest.mark.parametrize("solver", THREADED)
def test_a_late_learner_costs_samples_that_are_counted_and_never_the_limits_or_half_of_its_weights(
    threaded: Callable[[str], Path], solver: str
) -> None:
    expected = learning(solver, SIZE)
    numbers = expected.settings.numbers(expected.model.structure)
    delay = 10 * int(numbers.get("interval", 5 * numbers["block"]))  # intervals
    for seed in range(3):
        x, events = run_threaded(threaded(solver), expected, delay, seed)
        assert np.all((x >= LIMITS[0]) & (x <= LIMITS[1]))
        assert (events["torn"], events["dropped_blocks"] > 0) == (0, True)
        if not expected.settings.cyclic:
            assert min(events["changes"], events["late_offers"]) > 0
            assert np.any(x != expected.x)


# The schedule.


@pytest.mark.needs("cc")
def test_the_times_of_a_run_are_shown_in_tables_and_given_as_json(piezobench: CommandLine, tmp_path: Path) -> None:
    a_model().save(tmp_path / "model.json")
    words = ("realtime", tmp_path / "model.json", "--rate", 2000, "--seconds", 0.3)
    shown = piezobench.run(*words)
    assert "of 600 deadlines at 2000 Hz missed, and " in shown.stdout
    printed = json.loads(piezobench(*words, "--json").stdout)
    for what, capability in (("memory", "locking memory"), ("fifo", "SCHED_FIFO"), ("core", "pinning to a core")):
        assert (printed["allowed"][what] == "yes") == (f"Without {capability}" not in shown.stdout)
    learning = json.loads(piezobench(*words, "--part", "learning", "--priority", 0, "--json").stdout)
    assert learning["allowed"]["fifo"] == "not asked for"
    for figures in (printed, learning):
        histograms = ["wake-up", "service", "response", "null response"]
        assert (figures["samples"], list(figures["histograms_us"])) == (600, histograms)
        assert all(sum(counts.values()) == 600 for counts in figures["histograms_us"].values())
        for tail in figures["us"].values():
            assert tail["p50"] <= tail["p99"] <= tail["max"]
            assert tail["p99.99"] is None  # 600 samples cannot support it


@pytest.mark.needs("cc")
def test_the_program_waits_for_a_core_that_a_race_holds_and_then_holds_it_until_it_ends_or_is_killed(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    a_model().save(tmp_path / "model.json")
    words = ("realtime", tmp_path / "model.json", "--rate", 100, "--seconds", 1000, "--priority", 0, "--core")
    with cores.claim() as core:
        call = piezobench.start(*words, core.number)
        wait_until(lambda: call.stderr.read_text() == "waiting for a core: other measurements occupy all of them\n")
        assert not pacing(call.pid)
    wait_until(lambda: pacing(call.pid))
    assert f" {core.number} times" in pacing(call.pid)[0]
    with socket.socket(socket.AF_UNIX) as other, pytest.raises(OSError, match="in use"):
        other.bind(f"\0piezobench-core{core.number}")
    call.kill()
    call.wait()
    wait_until_gone(call.pid)  # with the C program
    cores.claim(core.number).close()


@pytest.mark.slow
@pytest.mark.needs("cc")
def test_a_rate_that_no_step_can_hold_misses_deadlines() -> None:
    hurried = real_time(a_model(20, 9), learning_of("continuous"), 1e6, 0.02)
    response = hurried.times_us["response"]
    assert hurried.missed("response") > 0.9 * response.size
    assert response[-1] > response[0]  # late ones are not left out: the delay adds up


def test_refusals_of_the_system_are_reported(tmp_path: Path) -> None:
    write_sources(tmp_path, a_model(), ExportSettings())
    subprocess.run([program("make"), "loop", f"CC={program('gcc')}"], cwd=tmp_path, capture_output=True, check=True)

    def without_rights() -> None:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
        resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))

    with (tmp_path / "loop").open("rb") as loop:  # the user that it runs as may have no access to the folder
        done = subprocess.run(
            [f"/proc/self/fd/{loop.fileno()}", "1000", "0.05", "80", "4000", "/dev/null"],
            pass_fds=[loop.fileno()],
            user=65534 if os.geteuid() == 0 else None,  # nobody
            preexec_fn=without_rights,
            capture_output=True,
            text=True,
            check=True,
        )
    allowed = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    # there is no core 4000
    assert (allowed["fifo"], allowed["core"]) == ("Operation not permitted", "Invalid argument")
    assert allowed["memory"] != "yes"


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
        ("Cortex-M4F", None, None),
        ("Cortex-M7", None, DYNAMICS),
        pytest.param("Cortex-M7", None, None, marks=pytest.mark.slow),
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
