"""The comparison of two runs: on samples that do not differ it says so, on samples that differ it says which.

The samples are drawn with a fixed seed: delays with memory, bursts of a neighbour and an offset of each process, as times
have. A real pair of runs is compared by ``python -m bench.comparison.matched RUN_A RUN_B``.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import Race

from bench.comparison import matched as compare_rows
from bench.comparison.matched import LEVEL, NAMES, Comparison, compare, effects_of, noise_of
from bench.comparison.paired import Effect, benjamini_hochberg, effect, holm, log_ratios, p_values

ROWS, TURNS, SEEDS = 200, 60, 10
OFFSET = 0.02
"""Standard deviation of the logarithm of what a fresh process changes."""


def times(rng: np.random.Generator, level: float = 1.0) -> np.ndarray:
    """Nanoseconds of one process: an offset of its own, noise with memory, some long delays."""
    noise = np.zeros(TURNS)
    for i in range(1, TURNS):
        noise[i] = 0.7 * noise[i - 1] + 0.03 * rng.normal()
    delays = np.where(rng.random(TURNS) < 0.03, rng.exponential(3.0, TURNS), 0.0)
    return 20_000.0 * level * np.exp(noise + OFFSET * rng.standard_t(5)) * (1.0 + delays)


def field(rng: np.random.Generator, changed: dict[int, float] | None = None, shared: float = 1.0,
          repeats: int = 1) -> pd.DataFrame:
    """Effects of many rows, of which some are changed by a factor, and all of the second problem by a common one."""
    rows = []
    for row in range(ROWS):
        problem = "one" if row < ROWS // 2 else "two"
        level = (changed or {}).get(row, 1.0) * (shared if problem == "two" else 1.0)
        ratios = [log_ratios(times(rng), times(rng, level)) for _ in range(repeats)]
        rows.append({**dict.fromkeys(NAMES, ""), "problem": problem, "solver": f"s{row}", "task": f"t{row}",
                     "effect": effect(ratios, rng, 200)})
    return pd.DataFrame(rows)


def found(comparison: Comparison) -> set[str]:
    return set(comparison.table.solver[comparison.table.significant])


@pytest.mark.parametrize("correction", ["holm", "bh"])
def test_two_runs_of_the_same_differ_in_at_most_one_row_in_twenty(correction: str) -> None:
    shares = [compare(field(np.random.default_rng(seed)), correction=correction).share for seed in range(SEEDS)]
    assert max(shares) <= LEVEL
    assert np.mean(shares) <= LEVEL / 4


def test_rows_of_few_samples_do_not_differ_by_chance_either(monkeypatch: pytest.MonkeyPatch) -> None:
    for turns in (compare_rows.FEWEST, 2 * compare_rows.FEWEST):
        monkeypatch.setattr(sys.modules[__name__], "TURNS", turns)
        assert max(compare(field(np.random.default_rng(seed))).share for seed in range(SEEDS)) <= LEVEL


def test_rows_that_are_slower_by_more_than_the_noise_are_found_and_hardly_another() -> None:
    changed = dict.fromkeys(range(0, ROWS, 20), 1.35)
    comparison = compare(field(np.random.default_rng(1), changed))
    asked = {f"s{row}" for row in changed}
    assert asked <= found(comparison)
    assert len(found(comparison) - asked) <= 2
    ratios = comparison.table.set_index("solver").ratio[list(asked)]
    assert ratios.between(1.2, 1.5).all()


def test_several_processes_find_what_one_leaves_open() -> None:
    changed = dict.fromkeys(range(0, ROWS, 20), 1.1)
    once, often = (found(compare(field(np.random.default_rng(2), changed, repeats=repeats))) for repeats in (1, 6))
    assert {f"s{row}" for row in changed} <= often
    assert len(once) < len(often) <= len(changed) + 2


def test_what_all_rows_of_a_problem_share_is_the_machines_and_no_solvers() -> None:
    comparison = compare(field(np.random.default_rng(3), {5: 1.5}, shared=1.8))
    assert found(comparison) == {"s5"}
    assert np.exp(comparison.shared["", "two", ""]) == pytest.approx(1.8, rel=0.05)
    assert np.exp(comparison.shared["", "one", ""]) == pytest.approx(1.0, rel=0.05)


def test_a_handful_of_rows_keeps_what_it_shares_and_takes_the_noise_from_an_a_a_pair() -> None:
    few = field(np.random.default_rng(4), dict.fromkeys(range(ROWS), 1.5)).head(3)
    noise = noise_of(field(np.random.default_rng(5)))
    assert noise == pytest.approx(OFFSET * 2**0.5, rel=0.6)
    assert compare(few, noise).share == 1.0


def test_the_deviation_covers_memory_that_independent_resampling_would_miss() -> None:
    rng = np.random.default_rng(6)
    thetas, deviations = [], []
    for _ in range(200):
        noise = np.zeros(TURNS)
        for i in range(1, TURNS):
            noise[i] = 0.6 * noise[i - 1] + 0.1 * rng.normal()
        one = effect([noise], rng, 200)
        thetas.append(one.log_ratio)
        deviations.append(one.deviation)
    independent = 1.2533 * 0.125 / np.sqrt(TURNS)  # of the median, had the 0.125 of each value no memory
    assert np.median(deviations) > 1.2 * independent
    assert np.median(deviations) > 0.6 * np.std(thetas)


def test_samples_are_paired_by_place_and_the_longer_one_is_cut() -> None:
    np.testing.assert_allclose(log_ratios([10, 20, 40], [20, 40, 40, 99]), np.log([2.0, 2.0, 1.0]))


def test_corrections_keep_the_order_and_holm_is_the_stricter() -> None:
    p = np.random.default_rng(7).random(50) ** 3
    for correction in (holm, benjamini_hochberg):
        adjusted = correction(p)
        assert (adjusted >= p).all()
        assert (np.diff(adjusted[np.argsort(p)]) >= 0).all()
    assert (holm(p) >= benjamini_hochberg(p)).all()


def test_an_effect_without_any_noise_is_certain_and_none_is_none() -> None:
    sure = Effect(0.5, 0.0, 30, 1)
    assert p_values([sure, replace(sure, log_ratio=0.0)], 0.0).tolist() == [0.0, 1.0]


def test_a_run_compared_with_itself_differs_nowhere(clean_race: Race, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(clean_race.run.path)
    assert compare(effects_of(clean_race.run, clean_race.run)).share == 0.0
    for what in ("interleaved_solve", "solve"):
        assert compare_rows.main([path, path, "--what", what]) == 0
        assert "0 of " in capsys.readouterr().out


def test_a_comparison_with_what_is_no_run_is_one_sentence(clean_race: Race, tmp_path: Path,
                                                          capsys: pytest.CaptureFixture[str]) -> None:
    path = str(clean_race.run.path)
    for words, said in (([path, str(tmp_path)], "is not a run"), ([path, path, "--what", "coffee"], "no task has 3 times")):
        assert compare_rows.main(words) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1
