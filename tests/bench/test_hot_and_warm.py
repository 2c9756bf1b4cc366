"""Cold and warm starts, hot and interleaved solves, several fresh processes, and the plan of the second pass.

A race on the schedule of 8 kHz: every answer is judged by its own sample, and late ones are counted."""

from contextlib import ExitStack
from pathlib import Path

import faulty_solvers
import numpy as np
import pandas as pd
import pytest
from measured_rows import NAN, form_of, ladder, row, table
from recording_files import text_file
from small_races import Race, raced

from bench.derived.measurements import Measurements
from bench.derived.schedule import FLOOR_LINE, KEPT, LATE, UNKNOWN, on_schedule, sentences
from bench.messages.task import NO_SETTING, Row, Status, Task, settings_ladder
from bench.problems.fresh import FreshData
from bench.problems.protocol import RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races import null_solver
from bench.races.measuring import interleave, timed
from bench.races.metrics import judge_timed
from bench.races.passes import LONGEST_INTERLEAVED_US, NEAR, planned
from bench.timing.clock import Effort
from bench.timing.percentiles import percentile
from solvers import Lane, Problem, describe, find, from_file

QP = Problem(np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([1.0, -4.0]), lb=np.zeros(2), ub=np.full(2, np.inf))


@pytest.fixture(scope="module")
def drift_race(tmp_path_factory: pytest.TempPathFactory) -> Race:
    """Two problems that follow each other, in two fresh processes; one solver ignores starts."""
    folder = tmp_path_factory.mktemp("drift")
    file = faulty_solvers.written(
        folder, "says_who", "setup(self)", "open(__file__ + '.pids', 'a').write(f'{os.getpid()}\\n')"
    )
    return raced(
        folder,
        "drift",
        "--set",
        "drift",
        "--limit",
        2,
        "--lane",
        "kernel",
        "--solver",
        file,
        "--solver",
        "quadprog",
        "--solver",
        "box_active_set",
        "--scaling",
        "scaled",
        "--repeats",
        2,
    )


def test_solvers_that_use_a_start_have_warm_rows_and_the_others_none(drift_race: Race) -> None:
    rows = drift_race.hot
    warm = set(rows.solver[rows.start == "warm"])
    assert warm == {"daqp", "osqp", "box_active_set"}
    assert set(rows.solver[rows.start == "cold"]) == warm | {"quadprog", "says_who", "null"}
    both = rows[rows.solver.isin(["daqp", "box_active_set"])]
    # repeats, problems, settings in the lanes of either, then warm lanes
    assert [*both.status] == [Status.ANSWERED] * (2 * 2 * (2 * 3 + 2) + 2 * 2 * (2 + 2))
    report = (drift_race.run.path / "report.md").read_text()
    assert "Started from the optimum of the problem before" in report
    assert "in 2 fresh processes" in report


def test_solvers_near_the_fastest_of_a_lane_and_the_floor_are_timed_longer_and_the_floor_in_three_thousand_calls(
    drift_race: Race, clean_race: Race
) -> None:
    for race in (drift_race, clean_race):
        longer = race.rows.query("timed == 'long'")
        floor = longer.query("solver == 'null'")
        assert set(longer.query("solver != 'null'").lane) == set(race.rows.lane) - {"qpsolvers"}
        assert set(floor.scaling) == set(race.rows.scaling)
        assert (floor.groupby(["scaling", "lane"]).samples.sum() >= 3000).all()


def assert_interleaved_as_planned(race: Race) -> pd.DataFrame:
    """The interleaved rows: those that the plan makes of the first pass, whatever a busy machine made slow."""
    rows = race.rows[race.rows.timed == "interleaved"]
    plan = planned(race.hot[race.hot.start == "cold"], 3000)
    lanes = ["scaling", "solver", "lane", "setting"]
    assert {*rows[lanes].itertuples(index=False)} == {*plan[plan.interleaved][lanes].itertuples(index=False)}
    # eight calls cannot support the 99th percentile
    assert ((rows.samples == 8) & rows.solve_us_p99.isna() & rows.answer_us.notna()).all()
    assert (rows[rows.solver != "null"].judged > 0).all()
    return rows


def test_quick_solvers_are_interleaved_in_every_round_at_one_setting_each(clean_race: Race) -> None:
    assert set(assert_interleaved_as_planned(clean_race).start) == {"cold"}


def test_a_solver_that_can_start_warm_is_interleaved_cold_and_warm(drift_race: Race) -> None:
    rows = assert_interleaved_as_planned(drift_race)
    starts = rows.groupby(["solver", "lane"]).start.value_counts().unstack(fill_value=0)
    assert set(rows.solver[rows.start == "warm"]) == {"daqp", "osqp", "box_active_set"} & set(rows.solver)
    assert (starts.cold == starts.warm)[starts.warm > 0].all()


def test_each_repeat_has_processes_of_its_own(drift_race: Race) -> None:
    pids = (drift_race.run.path.parent / "says_who.py.pids").read_text().split()
    rows = drift_race.rows[drift_race.rows.solver == "says_who"]
    passes = rows.assign(second=rows.timed != "hot")[["repeat", "second"]].drop_duplicates()
    assert len(set(pids)) == len(passes) >= 2
    assert pids == sorted(pids, key=[*dict.fromkeys(pids)].index)  # and none is gone back to


def test_no_row_is_rewritten_and_a_longer_measurement_is_a_row_of_its_own(clean_race: Race) -> None:
    assert not clean_race.rows.duplicated(["task", "timed", "repeat"]).any()
    longer = clean_race.rows.query("timed == 'long'")
    assert set(longer.task) <= set(clean_race.hot.task)
    assert clean_race.found.rows.set_index("task").answer_us[longer.task].tolist() == longer.answer_us.tolist()


def test_figures_are_those_of_the_raw_times_and_a_tail_is_missing_if_the_sample_is_too_small(clean_race: Race) -> None:
    times = clean_race.run.times()
    key = ["task", "timed", "repeat"]
    ns = times.set_index([*key, "what"]).ns
    assert {*times[key].itertuples(index=False)} == {*clean_race.rows[key].itertuples(index=False)}
    for one in clean_race.rows.itertuples():
        update, solve = (ns[one.task, one.timed, one.repeat, what] for what in ("update", "solve"))
        assert (solve.size, solve.max() / 1e3) == (one.samples, one.solve_us_max)
        np.testing.assert_equal(one.solve_us_p99, percentile(solve / 1e3, 0.99))
        assert one.answer_us == pytest.approx(np.median(update + solve) / 1e3) or one.cpu_us > 0.0


def test_interleaved_solves_are_in_the_order_of_the_seed_and_a_solver_that_fails_leaves_the_others(
    tmp_path: Path,
) -> None:
    note = "open({!r}, 'a').write(self.name + '\\n')".format(str(tmp_path / "order"))
    files = [
        *(faulty_solvers.written(tmp_path, name, "update(self, P)", note) for name in ("one", "two")),
        faulty_solvers.written(tmp_path, "tires", "solve(self)", "self.calls > 5 and os._exit(4)"),
    ]
    # their faults depend on a unit diagonal
    unit = form_of(Problem(np.eye(2), np.array([-1.0, 1.0]), lb=np.zeros(2)), cost_unit=1.0)
    orders = []
    for seed in ("a", "a", "b"):
        (tmp_path / "order").write_text("")
        with ExitStack() as running:
            children = {
                (entry.name, entry.lane): running.enter_context(SolverChild(entry)) for entry in map(from_file, files)
            }
            tasks = [Task("none", "none", "scaled", name, Lane(lane), NO_SETTING) for name, lane in children]
            times = interleave(tasks, children, unit, FreshData(unit, 12), seed)
        orders.append((tmp_path / "order").read_text())
        assert [(task.solver, len(outcome.answers), outcome.failure) for task, outcome in times] == [
            ("one", 12, ""),
            ("two", 12, ""),
            ("tires", 0, Status.CRASHED),
        ]
    assert orders[0] == orders[1] != orders[2]


@pytest.mark.parametrize(
    ("name", "lane"),
    [
        ("daqp", "direct"),
        ("box_active_set", "kernel"),
        ("box_active_set", "direct"),
        ("accelerated_projection", "kernel"),
        ("projected_difference", "kernel"),
    ],
)
def test_a_warm_solve_begins_at_its_start_and_does_not_change_it(name: str, lane: str) -> None:
    entry = find(name, lane)
    default = next(setting for setting in settings_ladder(describe(entry)) if setting.is_default)
    task = Task("none", "none", "scaled", entry.name, entry.lane, default, start="warm")
    best = np.array([0.0, 2.0])
    form = form_of(QP, cost_unit=1.0, starts={"warm": best})
    with SolverChild(entry) as child, SolverChild(null_solver.ENTRY) as null:
        fresh = FreshData(form, 7)
        outcome = timed(child, null, task, form, fresh, Effort(0.0, 7, 7))
    assert (outcome.failure, outcome.mutated) == ("", False)
    np.testing.assert_allclose(outcome.x, best, atol=1e-9)
    # fewer than seven where the process was off its core for long
    assert 0 < len(outcome.answers) == outcome.times["solve"].size <= 7
    problem, calls = RaceProblem("none", "none", {"scaled": form}), outcome.first_call + np.arange(len(outcome.answers))
    assert judge_timed(problem, fresh, calls, outcome.answers, 3)["timed_gap"] <= 1e-9
    np.testing.assert_array_equal(best, [0.0, 2.0])


DEFAULTS = row(setting="d", rung=-1, is_default=True, cost_gap=0.1)


def settings(rows: list[Row]) -> dict[str, str]:
    """The setting of each solver."""
    plan = planned(table(rows), 3000)
    return dict(zip(plan.solver, plan.setting, strict=True))


@pytest.mark.parametrize(
    ("rows", "setting"),
    [
        ([*ladder({"p1": [1e-5, 1e-8, 1e-11]}), DEFAULTS], "s2"),
        ([*ladder({"p1": [1e-5, 1e-8, 1e-8]}), DEFAULTS], "s1"),
        ([*ladder({"p1": [1e-5, 1e-5, 1e-5]}), DEFAULTS], "d"),
        ([*ladder({"p1": [NAN, NAN, NAN]}), DEFAULTS], "d"),
        *(  # whatever the data that a race draws for its timed answers
            (ladder({"p1": [1e-10, 1e-12], "p2": [1e-11, 1e-12]}, timed_gap=[timed_gap, 1e-12]), "s0")
            for timed_gap in (1e-11, 1e-3)
        ),
    ],
)
def test_the_setting_is_that_for_1e_9_else_for_1e_6_else_the_solvers_defaults(rows: list[Row], setting: str) -> None:
    assert settings(rows) == {"daqp": setting}


@pytest.mark.parametrize(
    ("samples", "longer"),
    [pytest.param(0, {"daqp", "near"}, id="few times"), pytest.param(3000, set(), id="enough times")],
)
def test_solvers_near_the_fastest_of_their_lane_are_timed_longer(samples: int, longer: set[str]) -> None:
    rows = [
        *ladder({"p1": [1e-12]}, solve_us_p50=1.0),
        *ladder({"p1": [1e-12]}, solver="near", solve_us_p50=NEAR, timed_gap=1e-3),
        *ladder({"p1": [1e-12]}, solver="far", solve_us_p50=1.1 * NEAR),
        *ladder({"p1": [1e-12]}, solver="wrapped", lane="qpsolvers"),
    ]
    plan = planned(table([{**each, "samples": samples} for each in rows]), 3000)
    assert set(plan.solver[plan.longer]) == longer


def test_a_lane_is_interleaved_on_all_problems_or_on_none() -> None:
    rows = [
        *ladder({"p1": [1e-12], "p2": [1e-12]}, solve_us_p50=LONGEST_INTERLEAVED_US),
        *ladder({"p1": [1e-12]}, solver="slow_once", solve_us_p50=1.0),
        *ladder({"p2": [1e-12]}, solver="slow_once", solve_us_p50=1.1 * LONGEST_INTERLEAVED_US),
        *ladder({"p1": [1e-12], "p2": [NAN]}, solver="fails_once"),
        row(setting="{}", rung=-1, is_default=True, solver="null", status="solver_failed"),
        *ladder({"p1": [1e-12]}, solver="takes_some"),
        row(problem="p2", solver="takes_some", status="unsupported"),
    ]
    plan = planned(table(rows), 3000)
    assert set(plan.solver[plan.interleaved]) == {"daqp", "null", "takes_some"}


SAMPLES = 600
FILE = """
import sys, time
from solvers.direct.daqp import Daqp

class Mine(Daqp):
    name = "{name}"

    def setup(self, problem):
        {at_setup}
        super().setup(problem)

    def solve(self, warm_start=None):
        # on the schedule alone, so that it is quick enough for the plan of every machine
        if sys._getframe(1).f_code.co_qualname.startswith("TimedSolver.scheduled"):
            time.sleep({sleep})
        return super().solve(warm_start) {wrong}

{forge}
"""
FORGE = """
from bench.races import worker

scheduled = worker.TimedSolver.scheduled

def forged(*arguments):
    outcome = scheduled(*arguments)
    outcome.times["sample"] += 1
    return outcome
"""


@pytest.fixture(scope="module")
def race(tmp_path_factory: pytest.TempPathFactory) -> Race:
    folder = tmp_path_factory.mktemp("schedule")
    changes: dict[str, dict[str, object]] = {
        "slow": {"sleep": 4e-4},
        "outside": {"wrong": "- 1.0"},
        "forges": {"at_setup": "worker.TimedSolver.scheduled = forged", "forge": FORGE},
    }
    usual = {"at_setup": "", "sleep": 0.0, "wrong": "", "forge": ""}
    files = (
        text_file(folder, FILE.format(**usual | {"name": name} | change), name=f"{name}.py")
        for name, change in changes.items()
    )
    return raced(
        folder,
        "run",
        *(word for file in files for word in ("--solver", file)),
        *("--schedule", SAMPLES, "--scaling", "scaled"),
    )


def test_a_solver_gets_the_data_of_each_sample_and_a_slow_one_the_newest(race: Race) -> None:
    rows = race.rows.query("timed == 'scheduled' and solver != 'forges'").set_index("solver")
    assert {"null", "daqp", "slow"} <= set(rows.index)
    assert ((rows.due == SAMPLES) & (rows.samples <= SAMPLES)).all()
    assert rows.samples["slow"] <= SAMPLES / 3
    assert rows.late["slow"] >= 0.9 * SAMPLES
    times = race.run.times().query("timed == 'scheduled'").set_index(["task", "what"]).ns
    for one in rows.itertuples():
        sample, response = times[one.task, "sample"], times[one.task, "response"]
        assert (sample.size, sample[-1], response.size) == (one.samples, SAMPLES - 1, SAMPLES)
        assert (np.diff(sample) > 0).all()
        assert (response > 125_000).sum() == one.late


def test_late_and_early_answers_are_judged_by_the_optimum_of_their_own_sample_before_they_are_clipped(
    race: Race,
) -> None:
    rows = race.rows[race.rows.timed == "scheduled"].set_index("solver")
    assert (rows.judged == rows.samples).all()
    assert max(rows.timed_gap[["daqp", "slow"]]) <= 1e-6
    assert rows.timed_violation["outside"] >= 0.1
    assert rows.misses_low["outside"] == rows.samples["outside"]


def test_the_report_says_who_keeps_the_schedule_and_times_on_it_are_no_hot_times(race: Race) -> None:
    assert "## On the schedule of 8 kHz" in (race.run.path / "report.md").read_text()
    table = on_schedule(race.found).set_index("solver")
    assert table.schedule["null"] == FLOOR_LINE
    assert table.schedule["slow"] in (LATE, UNKNOWN)  # on a busy machine nothing is known
    hot = race.rows[(race.rows.timed.isin(["hot", "long"])) & (race.rows.solver == "daqp")]
    merged = race.found.rows
    assert merged.samples[merged.task.isin(hot.task)].sum() <= hot.samples.sum()


@pytest.mark.parametrize(
    ("machine", "bouts", "us", "expected"),
    [(0, 0, 5, KEPT), (2, 5, 5, KEPT), (0, 40, 5, LATE), (2, 1, 500, LATE), (60, 60, 5, UNKNOWN)],
)
def test_a_solver_is_late_if_its_bouts_are_more_frequent_than_those_of_the_machine_or_it_is_late_at_most_samples(
    machine: int, bouts: int, us: int, expected: str
) -> None:
    rows = pd.DataFrame(
        row(solver=solver, timed="scheduled", due=3000, late=count, bouts=count, samples=3000)
        for solver, count in (("null", machine), ("daqp", bouts))
    )
    times = rows[["task", "timed", "repeat"]].assign(
        what="response", ns=[np.full(3000, 5_000), np.full(3000, 1000 * us)]
    )
    table = on_schedule(Measurements(rows, times))
    assert (table.set_index("solver").schedule.to_dict(), table["p99.9"].tolist()) == (
        {"null": FLOOR_LINE, "daqp": expected},
        [5.0, us],
    )
    assert ["cannot say" in sentence for sentence in sentences(table)] == [expected == UNKNOWN]
    assert on_schedule(Measurements(rows[1:], times[1:])).empty, "without the machine's own, nothing is known"


def test_a_process_that_answers_samples_that_never_came_has_tampered(race: Race) -> None:
    assert set(race.rows.query("solver == 'forges' and timed == 'scheduled'").status) == {str(Status.TAMPERED)}
