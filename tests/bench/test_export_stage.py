"""The exported controller at work. On a stage of one's own: however a run ends, the drive keeps its limits and comes to
rest. In two threads, step and learner: the same bits as in one thread if the learner is in time, and consistent weights
if it is late."""

import signal
import subprocess
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import hears_its_terminal
from exported_loops import LIMITS, LOOPS, Expected, learning, loop_of
from exported_programs import write_sources
from programs import program

from bench.export.building import EXACT, WARNINGS, write_files
from bench.export.c_source import export
from bench.export.settings import ExportSettings
from piezo_model import HysteresisCreepModel, ModelStructure

LOW, HIGH, REST, RATE_LIMIT, RATE = 20.0, 100.0, 40.0, 2000.0, 1000
STAGE = f"""
#define _GNU_SOURCE
#include "piezo_stage.h"

#include <math.h>
#include <stdio.h>
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
    return FAILS;
}}

void piezo_stage_close(void) {{ fclose(drives); }}
"""


def built(folder: Path, settings: ExportSettings, stage: str) -> None:
    """Export a controller to a folder and build the loop on a stage."""
    structure = ModelStructure.equidistant(
        n=5, m=3, x_range=(0.0, 150.0), y_range=(-20.0, 20.0), creep_rates=(1.0,), sample_time=1.0 / RATE
    )
    write_files(folder, export(HysteresisCreepModel.from_weights(structure, structure.straight_line), settings))
    (folder / "piezo_stage.c").write_text(stage)
    done = subprocess.run([program("make"), "loop"], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")  # no warning


@pytest.mark.needs("cc", "make")
@pytest.mark.parametrize("solver", [None, "projected_difference", "continuous"])
@pytest.mark.parametrize(
    ("end", "status"), [("time", 0), ("SIGHUP", 129), ("SIGINT", 130), ("SIGTERM", 143), ("stage", 1)]
)
def test_however_a_run_ends_the_drive_keeps_limits_and_rate_and_comes_to_rest(
    tmp_path: Path, solver: str | None, end: str, status: int
) -> None:
    settings = ExportSettings(part="learning", **loop_of(solver)) if solver else ExportSettings()
    built(tmp_path, settings, STAGE.replace("FAILS", "samples == 300" if end == "stage" else "0"))
    seconds = "0.5" if end in ("time", "stage") else "60"
    run = subprocess.Popen(
        ["./loop", str(RATE), seconds, "0", "-1", "times"],
        cwd=tmp_path,
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
    assert drives.min() >= LOW
    assert drives.max() <= HIGH
    assert np.abs(np.diff(drives, prepend=REST)).max() <= RATE_LIMIT / RATE * (1 + 1e-12)
    assert drives[-1] == REST
    # after a late sample, too, which the stage makes at every 150th
    moved, lasted = np.abs(drives[30:] - drives[:-30]), moments[30:] - moments[:-30]
    assert np.all(moved <= RATE_LIMIT * (lasted + 1.5 / RATE))
    assert len(times) == {"time": 500, "stage": 300}.get(end, len(times))
    assert len(times) <= len(drives)


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
    own = f"{{{LOW}, {HIGH}, {RATE_LIMIT}, {REST}}}"
    built(tmp_path, ExportSettings(), STAGE.replace(own, limits).replace("FAILS", "0"))
    done = subprocess.run(
        ["./loop", str(RATE), "1", "0", "-1", "times"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (2, sentence)
    assert not (tmp_path / "drives.txt").exists()


SOURCE = Path(__file__).with_name("two_threads.c")
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
INTERVALS = 10
KINDS = ("plain", "thread sanitizer")


@cache
def expected_of(solver: str) -> Expected:
    """Drives that Python computes, which learns at the end of each block."""
    return learning(solver, SIZE)


def works(folder: Path, *flags: str) -> bool:
    """Whether a program with these flags builds and runs here."""
    (folder / "nothing.c").write_text("int main(void) { return 0; }\n")
    made = subprocess.run(
        [program("gcc"), *flags, "nothing.c", "-o", "nothing"], cwd=folder, capture_output=True, check=False
    )
    return (
        made.returncode == 0 and subprocess.run([folder / "nothing"], capture_output=True, check=False).returncode == 0
    )


def threaded(folder: Path, expected: Expected, kind: str) -> Path:
    """The program of two threads."""
    flags = ("-O1", "-g", "-fsanitize=thread") if kind == "thread sanitizer" else ("-O2",)
    if not works(folder, *flags, "-pthread"):
        pytest.skip(f"gcc has no {kind} here")
    write_sources(folder, expected.model, expected.settings)
    (folder / "two_threads.c").write_text(SOURCE.read_text())
    (folder / "offering_learner.c").write_text(LEARNER)
    subprocess.run(
        [
            program("gcc"),
            "-D_POSIX_C_SOURCE=200809L",
            *WARNINGS,
            *EXACT,
            *flags,
            "-pthread",
            "two_threads.c",
            "offering_learner.c",
            "-o",
            "two_threads",
            "-lm",
        ],
        cwd=folder,
        check=True,
    )
    return folder / "two_threads"


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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("solver", LOOPS)
def test_a_learner_in_a_thread_of_its_own_that_is_in_time_changes_no_bit(
    tmp_path: Path, solver: str, kind: str
) -> None:
    expected = expected_of(solver)
    x, events = run_threaded(threaded(tmp_path, expected, kind), expected)
    np.testing.assert_array_equal(x, expected.x)
    assert (events["hand_overs"], events["refusals"]) == expected.events
    assert events["changes"] > 0
    assert events["late_offers"] == events["dropped_blocks"] == events["torn"] == 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("solver", ["projected_difference", "continuous"])
def test_a_late_learner_costs_samples_that_are_counted_and_never_the_limits_or_half_of_its_weights(
    tmp_path: Path, solver: str, kind: str
) -> None:
    expected = expected_of(solver)
    numbers = expected.settings.numbers(expected.model.structure)
    two_threads, delay = (
        threaded(tmp_path, expected, kind),
        INTERVALS * int(numbers.get("interval", 5 * numbers["block"])),
    )
    for seed in range(3):
        x, events = run_threaded(two_threads, expected, delay, seed)
        assert np.all((x >= LIMITS[0]) & (x <= LIMITS[1]))
        assert events["torn"] == 0
        assert events["dropped_blocks"] > 0
        if not expected.settings.cyclic:
            assert events["changes"] > 0
            assert events["late_offers"] > 0
            assert np.any(x != expected.x)
