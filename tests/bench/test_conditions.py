"""The machine of a run: sentinel, disturbances, and the lock of its core."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_races import Race

from bench.processes import sentinel
from bench.timing import cores, machine

HOLD = "from bench.timing import cores; core = cores.claim(); print(core.number, flush=True); input()"


def quiet(**change: object) -> dict[str, object]:
    return {
        "host": "one",
        "core": 1,
        "seconds": 10.0,
        "throttled": 0,
        "steal_percent": 0.0,
        "busy_cores": 1.0,
        "preemptions": 0,
        "timed_calls": 10_000,
        **change,
    }


def test_counters_of_this_machine_only_grow() -> None:
    before, _, after = machine.counters(), sum(range(10**6)), machine.counters()
    assert after["ticks"] >= after["busy"] >= before["busy"]
    between = machine.between(before, after)
    assert between["seconds"] > 0.0
    assert 0.0 <= between["steal_percent"] <= 100.0


def drifts(*notes: dict[str, object]) -> list[str]:
    """What is said of samples of the sentinel."""
    return sentinel.sentences(sentinel.table([{"host": "here", "core": 0, **note} for note in notes]))


def samples(*levels: float) -> dict[str, object]:
    return {"sentinel": [(float(i), [round(1e5 * level)] * 5) for i, level in enumerate(levels)]}


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (machine.disturbances([quiet(steal_percent=3.0)]), ["CPU steal 3.0 %"]),
        (machine.disturbances([quiet(throttled=2)]), ["The processor throttled 2 times"]),
        (machine.disturbances([quiet(busy_cores=2.5)]), ["kept 1.5 cores busy"]),
        (machine.disturbances([quiet(preemptions=100)]), ["100 preemptions in 10000"]),
        (machine.disturbances([quiet(), quiet()]), []),
        pytest.param(
            machine.disturbances([quiet(busy_cores=2.0), quiet(busy_cores=2.0, core=0)]), [], id="two cores of a host"
        ),
        pytest.param(
            machine.disturbances([quiet(busy_cores=2.0), quiet(busy_cores=2.0, host="two")]),
            ["kept 1.0 cores busy"],
            id="two hosts",
        ),
        (machine.disturbances([]), []),
        pytest.param(drifts(samples()), [], id="no sample"),
        pytest.param(drifts(samples(1.0, 1.0, 1.0, 1.05, 0.96)), [], id="less than a tenth"),
        pytest.param(
            drifts(samples(1.0, 1.0, 1.0, 1.25, 0.95)),
            [
                r"^The speed of the machine drifted: of 5 timings.*by -5 % to \+25 % from that of all",
                "in 20 % of 5 trials",
            ],
            id="more than a tenth",
        ),
        pytest.param(
            drifts(samples(*[1.0] * 20, *[1.6] * 21, *[1.0] * 10)),
            ["from that of all", "in 41 % of 51 trials, at most 60 % longer"],
            id="slow half of the time",
        ),
        pytest.param(drifts(samples(*(1.9 if i % 25 == 12 else 1.0 for i in range(100)))), [], id="few slow moments"),
        pytest.param(
            drifts(samples(*(1.9 if i % 5 == 2 else 1.0 for i in range(100)))),
            ["over 10 % longer than when undisturbed in 20 % of 100 trials, at most 90 % longer"],
            id="many slow moments without drift",
        ),
        pytest.param(
            drifts(*({"core": core, "sentinel": [(0.0, [100 * (core + 1)])]} for core in range(2))),
            [],
            id="cores of different speeds",
        ),
    ],
)
def test_each_disturbance_and_drift_is_one_warning_and_what_a_race_does_itself_is_none(
    found: list[str], expected: list[str]
) -> None:
    assert all(re.search(part, sentence) for part, sentence in zip(expected, found, strict=True))


def test_a_run_has_the_sentinels_samples_and_its_disturbances(clean_race: Race) -> None:
    stored = pd.read_parquet(clean_race.run.path / "sentinel.parquet")
    assert len(stored) >= 8  # at begin and end of two parts in two passes
    assert stored.at_s.is_monotonic_increasing
    assert all(level == np.median(ns) for level, ns in zip(stored.level_ns, stored.ns, strict=True))
    conditions = clean_race.run.settings["conditions"]
    assert len(conditions["parts"]) == 4
    assert conditions["sentinel_drift"] == pytest.approx(sentinel.drift(stored))
    assert sum(part["timed_calls"] for part in conditions["parts"]) == clean_race.rows.samples.sum()
    assert all(
        warning in text
        for text in ((clean_race.run.path / "report.md").read_text(), clean_race.call.said)
        for warning in conditions["warnings"]
    )


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A process that holds a core, and the core's number, with other folders for temporary files and home than ours."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path), "HOME": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)},
    )
    with process:
        yield process, int(process.stdout.readline())
        process.kill()


def test_a_process_that_waits_for_a_core_says_so_and_goes_on_when_the_one_that_holds_it_is_killed(
    holder: tuple[subprocess.Popen[str], int],
) -> None:
    process, theirs = holder
    with subprocess.Popen(
        [sys.executable, "-c", f"import os; os.sched_setaffinity(0, {{{theirs}}}); {HOLD}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as waiting:
        assert waiting.stderr.readline() == "waiting for a core: other measurements occupy all of them\n"
        process.kill()
        assert int(waiting.stdout.readline()) == theirs
        waiting.communicate("\n")


def test_a_core_is_held_by_one_process_of_the_machine_at_a_time_and_free_when_that_is_killed(
    holder: tuple[subprocess.Popen[str], int],
) -> None:
    (process, theirs), usable = holder, cores.usable()
    if len(usable) > 1:
        with cores.claim() as core:
            assert core.number != theirs
    process.kill()
    os.sched_setaffinity(0, {theirs})  # other tests may race at the same time: we wait for this one
    try:
        with cores.claim() as core:
            assert core.number == theirs
            os.sched_setaffinity(0, set(usable))
            with core.pinned():
                assert os.sched_getaffinity(0) == {theirs}
            assert os.sched_getaffinity(0) == set(usable)
    finally:
        os.sched_setaffinity(0, set(usable))
