"""What two runs say about times, on samples with a fixed seed whose truth is known.

Each process has an offset of its own with heavy tails, each block of a run a drift that all share, and the times in a block noise
with memory and bursts of a neighbour.
"""

import numpy as np
import pandas as pd
import pytest

from bench.comparison.lines import CANNOT_TELL, CHANGES, SAME, Times, compare_times

LANES, BLOCKS, TURNS, SEEDS = 40, 18, 10, 15
OFFSET = 0.015
"""Scale of the logarithm of what a fresh process changes."""


def levels(rng: np.random.Generator, count: int) -> np.ndarray:
    """Logarithms of the medians of one solver's turns in so many blocks."""
    shocks, noise = 0.04 * rng.normal(size=(TURNS, count)), np.zeros((TURNS, count))
    for i in range(1, TURNS):
        noise[i] = 0.7 * noise[i - 1] + shocks[i]
    delays = np.where(rng.random(noise.shape) < 0.05, rng.exponential(2.0, noise.shape), 0.0)
    return np.asarray(np.log(np.median(np.exp(noise) * (1.0 + delays), axis=0)))


def compared(seed: int, changed: dict[str, float] | None = None, lanes: int = LANES, repeats: int = 1, blocks: int = BLOCKS,
             smallest: float = 1.2, machine: float = 1.0) -> Times:
    """Two runs of which the second has the solvers changed by factors, and every second block by a common one."""
    rng, rows = np.random.default_rng(seed), []
    for repeat in range(repeats):
        drift = 0.3 * rng.normal(size=blocks) + np.log(machine) * (np.arange(blocks) % 2)
        for solver in ["null", *(f"s{i}" for i in range(lanes))]:
            offset = OFFSET * (rng.standard_t(5) - rng.standard_t(5)) + np.log((changed or {}).get(solver, 1.0))
            ratios = offset + drift + levels(rng, blocks) - levels(rng, blocks)
            rows += [{"task": f"{solver} {block}", "repeat": repeat, "timed": "in turns", "problem_set": "", "problem": str(block),
                      "scaling": "", "solver": solver, "lane": "direct", "log_ratio": ratio} for block, ratio in enumerate(ratios)]
    return compare_times(pd.DataFrame(rows), "null", smallest)


def found(times: Times) -> set[str]:
    return set(times.lines.solver[times.lines.finding.isin(CHANGES)])


def test_two_runs_of_the_same_hardly_ever_differ() -> None:
    false = [len(found(compared(seed))) for seed in range(SEEDS)]
    assert sum(false) <= 0.05 * SEEDS * LANES / 4
    assert max(false) <= 0.05 * LANES


def test_one_and_a_half_times_is_always_found_and_its_interval_holds_it_nearly_always() -> None:
    pairs = [compared(seed, {"s3": 1.5}) for seed in range(SEEDS)]
    assert all("s3" in found(times) for times in pairs)
    lines = pd.concat([times.lines[times.lines.solver == "s3"] for times in pairs])
    assert ((lines.ratio_low < 1.5) & (lines.ratio_high > 1.5)).mean() >= 0.9


def test_what_could_have_been_shown_is_shown_nine_times_in_ten() -> None:
    hits = []
    for seed in range(3):
        shown = compared(seed).lines.set_index("solver").shown
        hits += [solver in found(compared(seed, {solver: shown[solver]})) for solver in shown.index[::4]]
    assert np.mean(hits) >= 0.85


def test_the_effort_that_it_recommends_finds_what_was_asked_for() -> None:
    asked = 1.08
    pilot = compared(0, smallest=asked)
    assert pilot.lanes(CANNOT_TELL) > LANES / 2
    repeats = int(pilot.lines.repeats.quantile(0.9))
    assert 1 < repeats < 12
    hits = [f"s{i}" in found(compared(200 + i, {f"s{i}": asked}, repeats=repeats, smallest=asked)) for i in range(12)]
    assert np.mean(hits) >= 0.9


def test_what_all_solvers_share_in_a_block_is_the_machines_and_no_solvers() -> None:
    times = compared(3, {"s5": 1.5}, machine=1.8)
    assert found(times) == {"s5"}
    assert times.machine["in turns"] == pytest.approx(1.8**0.5, rel=0.2)


def test_several_changes_of_either_sign_are_found_with_their_ratios() -> None:
    changed = {"s1": 1.5, "s2": 0.6, "s3": 2.0, "s4": 1.7}
    times = compared(4, changed)
    assert found(times) == set(changed)
    ratios = times.lines.set_index("solver").ratio
    assert ratios[list(changed)].tolist() == pytest.approx(list(changed.values()), rel=0.12)


def test_rows_are_tested_in_lines_that_differ_only() -> None:
    rows = compared(5, {"s1": 2.0}).rows
    of_changed = rows.task.str.startswith("s1 ")
    assert rows[of_changed].change.eq("slower").mean() >= 0.9
    assert rows[~of_changed].change.eq("").all()
    assert rows[~of_changed].adjusted.isna().all()


def test_a_few_solvers_in_one_process_each_cannot_tell_and_several_processes_can() -> None:
    once, often = (compared(6, {"s1": 1.3}, lanes=3, repeats=repeats) for repeats in (1, 6))
    assert set(once.lines.finding) == {CANNOT_TELL}
    assert any(sentence.startswith("In 3 of 3 solver lanes a change") for sentence in once.sentences())
    assert often.lines.set_index("solver").finding.to_dict() == {"s0": SAME, "s1": "slower", "s2": SAME}


def test_a_solver_alone_has_nothing_to_tell_the_noise_by_but_its_processes() -> None:
    alone, repeated = compared(7, {"s0": 3.0}, lanes=1), compared(7, {"s0": 3.0}, lanes=1, repeats=5)
    assert found(alone) == set()
    assert found(repeated) == {"s0"}
    assert repeated.machine["in turns"] == 1.0


def test_runs_without_any_times_in_common_have_no_lines() -> None:
    nothing = compare_times(pd.DataFrame(columns=["task", "repeat", "timed", "problem_set", "problem", "scaling", "solver", "lane",
                                                  "log_ratio"]).astype({"log_ratio": float}), "null", 1.2)
    assert (len(nothing.lines), len(nothing.rows), nothing.sentences()) == (0, 0, [])


def test_two_solvers_alone_are_compared_at_once_and_nothing_can_be_told_of_them() -> None:
    times = compared(0, {"s1": 1.2}, lanes=2, blocks=3)
    assert set(times.lines.finding) == {CANNOT_TELL}
    assert times.lines.repeats.max() < 1000
