"""The exported step and its learner in two threads: the same bits as in one thread if the learner is in time, and
consistent weights if it is late."""

import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from exported_loops import LIMITS, LOOPS, Expected, learning
from exported_programs import write_sources
from programs import program

from bench.export.building import EXACT, WARNINGS

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


def built(folder: Path, expected: Expected, kind: str) -> Path:
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


def run(two_threads: Path, expected: Expected, delay: int = 0, seed: int = 0) -> tuple[np.ndarray, dict[str, int]]:
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
    x, events = run(built(tmp_path, expected, kind), expected)
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
    two_threads, delay = built(tmp_path, expected, kind), INTERVALS * int(numbers.get("interval", 5 * numbers["block"]))
    for seed in range(3):
        x, events = run(two_threads, expected, delay, seed)
        assert np.all((x >= LIMITS[0]) & (x <= LIMITS[1]))
        assert events["torn"] == 0
        assert events["dropped_blocks"] > 0
        if not expected.settings.cyclic:
            assert events["changes"] > 0
            assert events["late_offers"] > 0
            assert np.any(x != expected.x)
