"""Comparisons of runs and of versions of a solver: races in which one is slower, changed copies of a run, and tables by
hand or simulated, with known changes."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import slowed_solver
from browser import Browser
from command_line import CommandLine, in_process
from measured_rows import ladder, table
from programs import that_load
from simulated_pairs import pair, ratios
from small_races import Change, Race

from bench.comparison import report as comparison
from bench.comparison.compare import (
    CANNOT_TELL,
    FASTER,
    SAME,
    SLOWER,
    Comparison,
    compare_runs,
    compare_times,
    lost_tiers,
)
from bench.messages.task import Status
from bench.race_table import MISSES
from bench.store import Run
from solvers import describe, from_file

SLOWED = ("osqp", "direct")


def of_solver(rows: pd.DataFrame) -> pd.Series:
    return (rows.solver == SLOWED[0]) & (rows.lane == SLOWED[1])


def slowed(race: Race, factor: float, which: Callable = of_solver) -> Change:
    """Multiply every time of some solver lanes, in whole nanoseconds."""
    tasks = set(race.rows[which(race.rows)].task)
    return lambda times: times.assign(
        ns=[
            np.round(factor * ns).astype(np.int64) if task in tasks else ns
            for task, ns in zip(times.task, times.ns, strict=True)
        ]
    )


def less_accurate(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(cost_gap=rows.cost_gap.mask(of_solver(rows), 1e6))


def compared(a: Run, b: Run) -> Comparison:
    return compare_runs([a, b]).pairs[0]


def test_a_run_with_itself_shows_no_difference(piezobench: CommandLine, wide_race: Race, tmp_path: Path) -> None:
    path = wide_race.run.path
    call = piezobench.run("compare", path, path, path, "--out", tmp_path / "c", "--fail-on", "difference")
    assert (call.stdout.count("no difference in"), "WARNING" in call.stdout) == (2, False)


def only(column: str, value: object) -> Change:
    return lambda rows: rows[rows[column] == value]


@pytest.mark.parametrize(
    ("first", "second", "key"),
    [
        (only("lane", "direct"), lambda rows: rows.assign(digest="0" * 16), "digest"),
        (only("scaling", "scaled"), only("scaling", "raw"), "scaling"),
        (only("solver", "daqp"), only("solver", "osqp"), "solver"),
        (only("lane", "direct"), only("lane", "qpsolvers"), "lane"),
        (only("is_default", True), only("is_default", False), "settings"),
    ],
)
def test_runs_without_a_row_in_common_are_refused_by_the_key_that_differs(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path, first: Change, second: Change, key: str
) -> None:
    some = "osqp" if key in ("lane", "settings") else ""
    runs = [
        wide_race.copied(tmp_path / name, lambda rows, change=change: change(rows[rows.solver.str.contains(some)]))
        for name, change in (("a", first), ("b", second))
    ]
    assert piezobench("compare", *(run.path for run in runs), "--fail-on", "regression").refusal.endswith(
        f"and these differ in {key}"
    )


def with_changed_defaults(rows: pd.DataFrame) -> pd.DataFrame:
    texts = rows.setting.map(lambda text: json.dumps({**json.loads(text), "adaptive_rho": 2, "own": True}))
    return rows.assign(setting=rows.setting.mask(of_solver(rows), texts))


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    "change",
    [
        with_changed_defaults,
        pytest.param(
            lambda rows: rows.assign(problem=rows.problem + "-other", problem_set="elsewhere"), id="other names"
        ),
    ],
)
def test_neither_the_names_of_problems_nor_the_defaults_of_a_version_are_keys(
    wide_race: Race, tmp_path: Path, change: Change
) -> None:
    other = wide_race.copied(tmp_path / "other", lambda rows: less_accurate(change(rows)))
    found, back = compared(wide_race.run, other), compared(other, wide_race.run)
    assert (*map(len, found.alone), *set(found.times.finding)) == (0, 0, SAME)
    assert {"low", "mid"} <= set(found.lost.tier) == set(back.gained.tier[of_solver(back.gained)])
    assert back.regressions == 0 < found.regressions


def test_three_runs_stand_side_by_side_on_what_all_have_and_the_document_is_complete(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path
) -> None:
    slow = wide_race.copied(tmp_path / "slow", times=slowed(wide_race, 1.2))
    worse = wide_race.copied(tmp_path / "worse", lambda rows: less_accurate(rows[rows.problem != rows.problem.max()]))
    words = ("compare", wide_race.run.path, slow.path, worse.path, "--out", tmp_path / "c", "--fail-on", "regression")
    call, shown = piezobench(*words, "--json"), piezobench(*words).stdout
    document = json.loads(call.stdout)
    written = json.loads((tmp_path / "c" / "comparison.json").read_text())
    assert (document, document["format"], document["version"], call.status) == (written, "piezobench-comparison", 5, 3)
    one, _ = document["comparisons"]
    assert (one["regressions"], one["lost"], one["gained"], one["difference"]) == (1, [], [], True)
    assert [(line["solver"], line["lane"], line["ratio"]) for line in one["lines"] if line["finding"] == "slower"] == [
        (*SLOWED, pytest.approx(1.2, rel=0.001))
    ]
    lines = pd.DataFrame(document["lines"])
    assert lines[of_solver(lines)].set_index("run").right.to_dict() == {1: 3, 2: 3, 3: 0}
    assert (set(lines.problems), set(lines.to_yardstick[lines.solver == "daqp"])) == ({3}, {1.0})
    assert (lines.to_floor.gt(1.0) & lines.miss_rate.between(0.0, 1.0)).all()
    assert "(1), slow (2) and worse (3) have 3 problems, " in " ".join(shown.split())
    assert re.search(r"^osqp +direct +3 .* lost 1e-3", shown, re.MULTILINE)


@pytest.mark.slow
def test_a_solver_that_waits_is_found_between_two_races_and_repeats_are_one_task(
    piezobench: CommandLine, tmp_path: Path
) -> None:
    names = ("daqp", "quadprog", "clarabel", "piqp", *that_load("proxsuite"), "qpalm", "scs", "osqp", "box_active_set")
    words = ("--lane", "direct", "--scaling", "scaled", "--limit", 3, "--budget", 0.002, "--repeats", 2)
    runs = [tmp_path / "runs" / name for name in ("before", "after")]
    for run, factor in zip(runs, (1.0, 3.0), strict=True):
        files = [*names, slowed_solver.write(tmp_path / run.name, factor)]
        piezobench.run(
            "race",
            *(word for file in files for word in ("--solver", file)),
            *words,
            "--name",
            run.name,
            "--out",
            run.parent,
        )
    call = piezobench("compare", *runs, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 3, call.stdout
    assert re.search(r"^slowed +direct +2 .* [1-4]\.\d\d +slower$", call.stdout, re.MULTILINE)
    found = compared(*map(Run.open, runs))
    assert (found.times.problems <= 6).all()  # repeats of a measurement are one task
    assert not any(rows.index.has_duplicates for rows in found.alone)


def test_a_run_that_is_faster_has_a_difference_and_no_regression_and_cannot_tell_of_a_thousandth(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path
) -> None:
    some, others = (
        slowed(wide_race, factor, lambda rows, lane=lane: rows.lane == lane)
        for lane, factor in (("direct", 1.01), ("kernel", 0.99))
    )
    slow = wide_race.copied(tmp_path / "slow", times=lambda times: others(some(slowed(wide_race, 3.0)(times))))
    words = ("compare", slow.path, wide_race.run.path, "--out", tmp_path / "c", "--fail-on")
    further = (("difference",), ("regression",), ("regression", "--smallest", 1.001))
    assert [piezobench(*words, *more).status for more in further] == [3, 0, 4]


@pytest.mark.parametrize(
    ("kept", "slow", "factor", "said"),
    [
        pytest.param(
            lambda rows: rows.solver != "",
            lambda rows: rows.solver != "",
            2.0,
            "The field as a whole changed by a factor of 2.00.* and the reference workload timed beside it by 1.00",
            id="all",
        ),
        pytest.param(
            lambda rows: of_solver(rows) | (rows.solver == "null"),
            of_solver,
            1.2,
            "In 1 of 1 solver lane a change by a factor of 1.2 may have gone unseen: too few lanes race to tell a "
            "change from noise",
            id="one that raced alone",
        ),
    ],
)
def test_if_all_that_race_are_slower_and_the_fixed_piece_of_work_is_not_the_comparison_states_it_and_cannot_tell(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path, kept: Callable, slow: Callable, factor: float, said: str
) -> None:
    runs = [
        wide_race.copied(tmp_path / str(by), lambda rows: rows[kept(rows)], slowed(wide_race, by, slow)).path
        for by in (1.0, factor)
    ]
    call = piezobench("compare", *runs, "--out", tmp_path / "c", "--fail-on", "regression")
    assert call.status == 4, call.stdout
    assert re.search(said, call.said)


def test_a_lane_with_too_few_times_cannot_be_compared(wide_race: Race, tmp_path: Path) -> None:
    few = set(wide_race.rows[of_solver(wide_race.rows)].task)
    other = wide_race.copied(
        tmp_path / "few", times=lambda times: times.assign(ns=times.ns.mask(times.task.isin(few), times.ns.str[:2]))
    )
    found = compared(wide_race.run, other)
    expected = np.where(of_solver(found.times), CANNOT_TELL, SAME)
    assert found.times.finding.tolist() == expected.tolist()
    assert (CANNOT_TELL in expected, found.differences, found.cannot_tell) == (True, 0, True)


def test_settings_that_one_of_the_runs_did_not_run_are_not_compared(wide_race: Race, tmp_path: Path) -> None:
    rows = wide_race.rows.copy()
    ended = of_solver(rows) & (rows.rung > 1)
    rows.loc[ended, ["status", "cost_gap"]] = [str(Status.NOT_RUN), np.nan]
    found = compared(wide_race.run, wide_race.copied(tmp_path / "ended", lambda _: rows))
    assert ended.any()
    assert (found.regressions, *map(len, found.alone)) == (0, rows.task[ended].nunique(), 0)


def test_different_settings_and_machines_come_first_and_all_fits_on_a_screen(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path
) -> None:
    other = wide_race.copied(
        tmp_path / "elsewhere",
        lambda rows: rows[~of_solver(rows)],
        slowed(wide_race, 1.2, lambda rows: rows.solver == "daqp"),
        settings={"seed": 7},
        machine={"processor": "An abacus"},
        lanes={"daqp (direct)": "0.0.1"},
    )
    call = piezobench("compare", wide_race.run.path, other.path, "--out", tmp_path / "c")
    lines, output = call.stdout.splitlines(), call.said
    assert len(lines) <= 40
    assert max(map(len, lines[:-1])) <= 100
    assert output.startswith("WARNING: Different machines: processor is")
    for warning in ("settings: seed is 0 in the first run and 7 in the second.", "solvers: daqp (direct) is"):
        assert f"WARNING: Different {warning}" in output
    count = wide_race.rows[of_solver(wide_race.rows)].task.nunique()
    assert output.count(f"Only {wide_race.run.path.name} has {count} rows, of osqp (direct).") == 1
    assert "An abacus" in (tmp_path / "c" / "comparison.md").read_text()


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("change", "status", "says"),
    [
        (less_accurate, 3, "tiers are lost"),
        (lambda rows: rows, 0, "no difference"),
        (lambda rows: rows.assign(status=rows.status.mask(of_solver(rows), str(Status.MISSED))), 3, "lane fails"),
    ],
)
def test_another_version_of_a_lane_is_named_and_meets_the_one_before(
    piezobench: CommandLine, wide_race: Race, tmp_path: Path, change: Change, status: int, says: str
) -> None:
    edited = wide_race.copied(tmp_path / "edited", change, lanes={"osqp (direct)": "0.0.1"})
    call = piezobench("compare", wide_race.run.path, edited.path, "--out", tmp_path / "c", "--fail-on", "regression")
    assert (call.status, "Only " in call.stdout) == (status, False)
    assert re.search(f"WARNING: Different solvers: osqp .direct. is .*{says}", call.said)


def test_the_page_shows_what_differs_and_markdown_survives_any_name(
    browser: Browser, wide_race: Race, tmp_path: Path
) -> None:
    found = compare_runs([wide_race.run, wide_race.copied(tmp_path / "b<script>|`x`", less_accurate)])
    page = comparison.write(found, comparison.report(found), tmp_path / "c")
    assert browser.sections(page) == []
    first = "return document.querySelector('.grid tbody tr:nth-child(2)').textContent"
    assert re.search("osqp.*lost 1e-3", browser.run(first))
    markdown = page.with_suffix(".md").read_text()
    assert {line.count("|") for line in markdown.splitlines() if line.startswith("|")} == {len(comparison.COLUMNS) + 1}
    assert "<script>" not in markdown


PAIRS = 15


def times(by_lane: list[np.ndarray], smallest: float = 1.2, **changed: float) -> pd.DataFrame:
    return compare_times(pair(by_lane, changed), smallest)[0].set_index("solver")


def quiet(lanes: int = 8, problems: int = 6, offset: float = 0.01) -> list[np.ndarray]:
    """Lanes evenly spread from −offset to offset, on problems that the machine meets at different speeds."""
    return [np.full(problems, own) + 0.3 * np.arange(problems) for own in np.linspace(-offset, offset, lanes)]


def test_two_runs_of_the_same_solvers_hardly_ever_differ() -> None:
    chance = np.random.default_rng(0)
    findings = [set(times(ratios(chance, 40, 18)).finding) for _ in range(PAIRS)]
    assert sum(bool(found & {SLOWER, FASTER}) for found in findings) <= 1


@pytest.mark.parametrize(("factor", "finding"), [(1.2, SLOWER), (1 / 1.2, FASTER)])
def test_a_relevant_change_is_found_on_a_quiet_machine_and_otherwise_cannot_be_told(
    factor: float, finding: str
) -> None:
    chance = np.random.default_rng(0)
    found = [times(ratios(chance, 40, 18, offset=0.008), s3=factor).finding["s3"] for _ in range(PAIRS)]
    assert found.count(finding) >= 0.8 * PAIRS
    assert SAME not in found


def test_the_common_change_on_a_problem_is_divided_out_and_changes_of_either_sign_have_their_ratios() -> None:
    found, field = compare_times(pair(quiet(), {"s5": 1.5, "s2": 0.6}), 1.2)
    found = found.set_index("solver")
    changed = {"s2": FASTER, "s5": SLOWER}
    assert found.finding.to_dict() == {f"s{i}": SAME for i in range(8)} | changed
    factors = [*found.ratio[[*changed]], field.factor["interleaved"]]
    assert factors == pytest.approx([0.6, 1.5, np.exp(0.75)], rel=0.02)


def test_intervals_are_wider_by_five_normalised_median_absolute_deviations_of_the_lanes() -> None:
    found, field = compare_times(pair(quiet(), {"s4": 1.08}), 1.2)
    middle = np.log(found.ratio)
    assert field.deviation["interleaved"] == pytest.approx(
        1.4826 * np.median(np.abs(middle - np.median(middle))), rel=1e-4
    )
    ends = [found.ratio / found.ratio_low, found.ratio_high / found.ratio]
    np.testing.assert_allclose(np.log(ends), 5.0 * field.deviation["interleaved"], rtol=1e-6)


UNEVEN = [quiet()[0] + np.linspace(-0.3, 0.3, 6), *quiet()[1:]]


@pytest.mark.parametrize(
    ("lanes", "smallest", "changed", "findings"),
    [
        (UNEVEN, 1.2, {}, [CANNOT_TELL] + 7 * [SAME]),
        (UNEVEN, 2.0, {}, 8 * [SAME]),
        pytest.param(quiet(3), 1.2, {"s1": 1.5}, [CANNOT_TELL, SLOWER, CANNOT_TELL], id="half as long again, of three"),
        pytest.param(quiet(3), 1.2, {}, 3 * [CANNOT_TELL], id="nothing is said of three"),
        *(
            pytest.param(quiet(*shape), 1.2, {"s0": 3.0}, shape[0] * [CANNOT_TELL], id=f"{shape} lanes and problems")
            for shape in ((2, 6), (8, 2))
        ),
    ],
)
def test_an_interval_that_holds_one_and_the_smallest_ratio_that_matters_cannot_tell(
    lanes: list[np.ndarray], smallest: float, changed: dict[str, float], findings: list[str]
) -> None:
    found = times(lanes, smallest, **changed)
    assert found.finding.to_dict() == {f"s{i}": finding for i, finding in enumerate(findings)}
    assert np.isinf(found.ratio_high).all() == (min(len(lanes), len(lanes[0])) < 3)


@pytest.mark.parametrize(("offset", "finding"), [(0.02, SAME), (0.06, CANNOT_TELL)])
def test_a_field_that_deviates_by_more_than_three_per_cent_cannot_tell_of_any_lane(offset: float, finding: str) -> None:
    found, field = compare_times(pair(quiet(9, offset=offset)), 1.2)
    assert (field.deviation["interleaved"] > 0.03, *set(found.finding)) == (finding == CANNOT_TELL, finding)


@pytest.mark.parametrize(("offset", "used", "other"), [(0.005, "hot", "interleaved"), (0.02, "interleaved", "hot")])
def test_the_times_on_which_lanes_deviate_less_are_used_unless_there_are_too_few(
    offset: float, used: str, other: str
) -> None:
    both = pd.concat([pair(quiet(offset=offset), {}, "hot"), pair(quiet())])
    lacking = both[(both.timed == other) | (both.solver != "s1") | (both.digest == "p0")]
    found = compare_times(lacking, 1.2)[0].set_index("solver")
    assert found.timed.to_dict() == {f"s{i}": other if i == 1 else used for i in range(8)}
    assert set(found.finding) == {SAME}


def test_runs_without_any_times_in_common_have_no_lanes() -> None:
    found, field = compare_times(pair(quiet())[:0].astype({"level_a": float, "level_b": float}), 1.2)
    assert (len(found), len(field)) == (0, 0)


PROBLEMS = [f"p{i}" for i in range(9)]
GAPS = dict.fromkeys(PROBLEMS, (1e-5, 1e-11))


def run(gaps: dict[str, tuple[float, float]] = GAPS, **known: object) -> pd.DataFrame:
    return table(ladder(gaps, **known))


def lost(a: pd.DataFrame, b: pd.DataFrame) -> list[str]:
    return lost_tiers(a, b).tier.tolist()


@pytest.mark.parametrize(
    ("before", "after", "tiers"),
    [
        (run(), run({**GAPS, "p0": (1e-5, 1e-8)}), ["high"]),
        pytest.param(run({**GAPS, "p0": (1e-5, 1e-8)}), run(), [], id="the other way round it is gained"),
        pytest.param(
            run({**GAPS, "p0": (1e-11, 1e-11)}),
            run(dict.fromkeys(PROBLEMS, (1.0, 1e-11))),
            [],
            id="another setting that reaches it keeps it",
        ),
        pytest.param(
            run(),
            run().assign(status=str(Status.CRASHED), cost_gap=math.nan),
            ["low", "mid", "high"],
            id="a solver that crashes loses every tier",
        ),
    ],
)
def test_a_tier_that_one_problem_no_longer_meets_by_its_first_answer_is_lost(
    before: pd.DataFrame, after: pd.DataFrame, tiers: list[str]
) -> None:
    assert lost(before, after) == tiers


@pytest.mark.parametrize(
    ("judged", "misses", "problems", "is_lost"),
    [(300, 9, 1, False), (300, 10, 1, True), (300, 1, 9, False), (300, 2, 9, True), (3, 3, 2, False), (3, 3, 3, True)],
)
def test_timed_answers_lose_a_tier_where_more_of_them_miss_it_than_by_chance(
    judged: int, misses: int, problems: int, is_lost: bool
) -> None:
    before = run(judged=judged)
    wrong = before.problem.isin(PROBLEMS[:problems])
    after = before.assign(timed_gap=np.where(wrong, 1.0, 0.0), **dict.fromkeys(MISSES.values(), misses * wrong))
    assert (lost(before, after), lost(after, before)) == (["low", "mid", "high"] if is_lost else [], [])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "smallest", "finding", "status"),
    [(1.0, 1.5, SAME, 0), (1.3, 1.2, SLOWER, 3)],
)
def test_a_slower_version_is_found_and_the_same_version_is_not(
    piezobench: CommandLine, tmp_path: Path, factor: float, smallest: float, finding: str, status: int
) -> None:
    a, b = (slowed_solver.write(tmp_path / name, times) for name, times in (("a", 1.0), ("b", factor)))
    said = piezobench("compare", "--versions", a, b, "--smallest", smallest, "--fail-on", "regression", "--json")
    found = json.loads(said.stdout)
    assert (found["finding"], said.status) == (finding, status)
    assert found["low"] < found["ratio"] < found["high"]
    assert found["gap"][0] == found["gap"][1] > 0.0


WRONG = """
from solvers.direct.quadprog import Quadprog


class Wrong(Quadprog):
    name = "wrong"

    def solve(self, warm_start=None):
        return {change}
"""


def test_a_version_that_is_wrong_is_a_regression_however_fast_and_one_that_fails_is_refused(tmp_path: Path) -> None:
    words, right = ("--smallest", 100, "--fail-on", "regression"), tmp_path / "right.py"
    for name, change, status, said in (
        ("right", "{}", 0, ""),
        ("wrong", "1.0001 * {}", 3, f" is less accurate than {right}."),
        ("nan", "float('nan') * {}", 3, f" is less accurate than {right}."),
        (
            "broken",
            "1 / 0",
            2,
            ": failed at measured/afm_head: adapter_failed ZeroDivisionError: division by zero (broken.py:",
        ),
    ):
        file = tmp_path / f"{name}.py"
        file.write_text(WRONG.format(change=change.format("super().solve()")))
        call = in_process("compare", "--versions", right, file, *words)
        output = " ".join((call.stdout + call.stderr).split())
        assert (call.status, "less accurate" in output) == (status, status == 3)
        assert said == "" or f"{file}{said}" in output
        assert (describe(from_file(file)).version == describe(from_file(right)).version) == (file == right)
