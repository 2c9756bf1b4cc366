"""The stream race: real solvers in real processes on the real clock.

Nothing here asks how fast the machine is. What is asked is that the books are kept right, whatever it did.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cheating_solvers
import numpy as np
import pandas as pd
import pytest
from browser import Browser
from command_line import CommandLine
from conftest import killed_and_resumed

import solvers
from bench.messages.progress import silent
from bench.messages.task import Outcome
from bench.races.kind import kind_of, kinds
from bench.races.stream import figures as stream_figures
from bench.races.stream import report
from bench.races.stream.race import STREAM, StreamRace, StreamSettings
from bench.races.stream.stream_problem import StreamProblem, make
from bench.report.words import number
from bench.store import Run
from bench.timing.percentiles import QUANTILES
from bench.timing.schedule import PERIOD_NS, Timeline
from solvers import Lane, Status, Tier

# The race.

SLOW = """
import time
import numpy as np
from qpsolvers import Problem, Solution, solve_problem
from solvers.protocol import Lane, Solver, box_solution


class Slow(Solver):
    name = "{name}"
    lane = Lane.DIRECT
    algorithm = "dual active set"
    licence = "MIT"
    distribution = "nobody's"
    warm_startable = True
    calls = 0

    def setup(self, problem):
        self.lb, self.P, self.q = problem.lb, problem.P, problem.q

    def update(self, P=None, q=None):
        self.P, self.q = P.copy(), q.copy()

    def solve(self, warm_start=None):
        self.calls += 1
        {fault}
        self.x = solve_problem(Problem(self.P, self.q, lb=self.lb), solver="daqp").x
        return self.x

    def solution(self):
        return box_solution(Problem(self.P, self.q, lb=self.lb), self.x, True)
"""
FAULTS = {
    "sleeps_1_ms": "time.sleep(1e-3)",
    "has_no_answer": "return np.full(18, np.nan)",
    "gives_up_later": "assert self.calls < 30, 'no more'",
    "too_short": "return np.zeros(3)",
    "answers_later": "return type('Later', (), {'__array__': lambda *_, **__: (time.sleep(1e-3), np.zeros(18))[1]})()",
    "asks_for_its_last": "assert self.calls == 1 or np.array_equal(warm_start, self.x), 'another start'",
}
SAMPLES, KERNEL, GIVE_UP = 400, 1000, 150


@dataclass(frozen=True)
class Streamed:
    run: Run
    rows: pd.DataFrame
    times: pd.DataFrame
    stream: StreamProblem

    def row(self, solver: str, lane: str = "direct", repeat: int = 0) -> pd.Series:
        rows = self.rows[(self.rows.solver == solver) & (self.rows.lane == lane) & (self.rows.repeat == repeat)]
        assert len(rows) == 1
        return rows.iloc[0]

    def ns(self, row: pd.Series, what: str) -> np.ndarray:
        found = self.times[(self.times.task == row.task) & (self.times.what == what)]
        assert len(found) == 1
        return np.asarray(found.ns.iloc[0])

    def timeline(self, row: pd.Series) -> Timeline:
        began, service = self.ns(row, "began"), self.ns(row, "service")
        return Timeline(int(row.samples), self.ns(row, "sample"), self.ns(row, "data"), began, began, began + service)


@pytest.fixture(scope="module")
def streamed(tmp_path_factory: pytest.TempPathFactory) -> Streamed:
    folder = tmp_path_factory.mktemp("stream")
    for name, fault in FAULTS.items():
        (folder / f"{name}.py").write_text(SLOW.format(name=name, fault=fault))
    settings = StreamSettings(
        solvers=("daqp", "box_active_set", "recursive_active_set", "accelerated_projection"),
        lanes=(Lane.KERNEL, Lane.DIRECT),
        samples=SAMPLES,
        kernel_samples=KERNEL,
        give_up=GIVE_UP,
        certified=12,
        repeats=2,
        solver_files=(
            *(str(folder / f"{name}.py") for name in FAULTS),
            str(cheating_solvers.written(folder, "times_itself")),
        ),
    )
    run = kinds()["stream"].start(folder, settings, "run")
    kinds()["stream"].carry_on(run, silent)
    return Streamed(
        run, run.rows(STREAM), run.times(), make(settings.experiment, SAMPLES, settings.time_constant_s, 12)
    )


def test_every_solver_lane_has_a_row_a_process_and_the_floor_is_looked_at_in_each_round(streamed: Streamed) -> None:
    counts = streamed.rows.groupby(["solver", "lane"]).repeat.nunique()
    assert (counts.drop(index=[("null", "direct")]) == 2).all()
    assert len(counts) == 4 + 4 + 7 + 1  # kernel, direct, the user's, and the machine
    assert counts["null", "direct"] == 4  # fifteen tasks a round, and one look before every ten


def test_the_null_solver_is_accounted_for_sample_by_sample(streamed: Streamed) -> None:
    for repeat in range(4):
        row = streamed.row("null", repeat=repeat)
        timeline = streamed.timeline(row)
        assert row.samples == SAMPLES
        assert row.missed == sum(response > PERIOD_NS for response in streamed.ns(row, "response").tolist())
        assert np.array_equal(timeline.response_ns, streamed.ns(row, "response"))
        assert row.unanswered == 0
        kept = streamed.stream.gaps(np.zeros((0, 18)), np.full(SAMPLES, -1))  # it keeps the answer of the start
        assert row.gap_mean == pytest.approx(kept.mean(), rel=1e-9)
        assert row.gap_max == pytest.approx(kept.max(), rel=1e-9)
        assert row.gap_max > 0.0


def test_a_solver_that_sleeps_misses_its_deadlines_and_pays_for_stale_answers(streamed: Streamed) -> None:
    row = streamed.row("sleeps_1_ms")
    assert row.missed == row.samples
    assert row.solves < row.samples
    assert row.samples >= GIVE_UP
    assert row.stopped == (f"late at each of the first {row.samples} samples" if row.samples < SAMPLES else "")
    assert row.reused == 1.0
    assert row.own_gap_max < 1e-9 < row.gap_max
    assert 0.0 < row.exact_gap_max <= row.gap_max * (1.0 + 1e-6)
    assert row.status == Status.OK  # its answers are right, and late


def test_solves_begin_when_their_sample_is_due_and_response_times_hold_service_times_and_waiting(
    streamed: Streamed,
) -> None:
    for _, row in streamed.rows[streamed.rows.paced & (streamed.rows.samples > 0)].iterrows():
        timeline = streamed.timeline(row)
        assert np.all(timeline.began >= timeline.solved * PERIOD_NS)
        includes = np.searchsorted(timeline.solved, np.arange(timeline.samples))
        assert np.all(timeline.response_ns >= timeline.service_ns[includes])
    slow = streamed.timeline(streamed.row("sleeps_1_ms"))
    # What each solve took says nothing of the samples that came due meanwhile.
    assert slow.response_ns.sum() > 5 * slow.service_ns.sum()
    assert slow.response_ns.size > 5 * slow.service_ns.size


@pytest.mark.parametrize("solver", ["daqp", "box_active_set", "recursive_active_set"])
def test_exact_solvers_are_exact_at_the_sample_they_answer(streamed: Streamed, solver: str) -> None:
    row = streamed.row(solver)
    assert row.status == Status.OK
    assert row.own_gap_max < 1e-9
    assert row.exact_instants == 12
    assert row.exact_difference < 1e-6
    assert not row.mutates_input
    assert row.solves == streamed.ns(row, "service").size


@pytest.mark.parametrize("solver", ["box_active_set", "recursive_active_set", "daqp"])
def test_the_compiled_loop_takes_more_rows_than_there_are_and_is_not_called_paced(
    streamed: Streamed, solver: str
) -> None:
    row = streamed.row(solver, "kernel")
    assert not row.paced
    assert row.samples == streamed.ns(row, "service").size == KERNEL > SAMPLES
    assert row.exact_gap_max < 1e-9
    assert row.stopped == ""


@pytest.mark.parametrize(
    ("solver", "lane", "status", "least_ns"),
    [
        # It asks another solver five times; of itself it says a nanosecond.
        pytest.param("times_itself", "kernel", Status.OK, 10_001, id="a user's compiled solver is timed from outside"),
        pytest.param("answers_later", "direct", Status.MISSED, 1_000_000, id="an answer is made within its time"),
        pytest.param("asks_for_its_last", "direct", Status.OK, 0, id="a warm start is the last answer"),
    ],
)
def test_a_solver_of_a_user_is_timed_on_the_schedule_from_start_to_array(
    streamed: Streamed, solver: str, lane: str, status: Status, least_ns: int
) -> None:
    row = streamed.row(solver, lane)
    assert (row.status, row.message, row.paced) == (status, "", True)
    assert streamed.ns(row, "service").min() >= least_ns
    assert row.solves > 1


@pytest.mark.parametrize(
    ("solver", "lane", "status", "said"),
    [
        ("accelerated_projection", "kernel", Status.UNSUPPORTED, "no compiled loop over rows"),
        ("gives_up_later", "direct", Status.ADAPTER_FAILED, "AssertionError: no more"),
        ("too_short", "direct", Status.ADAPTER_FAILED, "ValueError"),
    ],
)
def test_what_goes_wrong_is_a_row_of_its_own(
    streamed: Streamed, solver: str, lane: str, status: Status, said: str
) -> None:
    row = streamed.row(solver, lane)
    assert (row.status, row.samples) == (status, 0)
    assert said in row.message


def test_a_solver_without_an_answer_leaves_the_one_before_in_use(streamed: Streamed) -> None:
    row, kept = streamed.row("has_no_answer"), streamed.row("null")
    assert row.unanswered == row.solves
    assert row.status == Status.MISSED
    if row.samples == SAMPLES:  # it may have been stopped on a machine that is busy
        assert row.gap_mean == pytest.approx(kept.gap_mean, rel=1e-9)


def race_of(streamed: Streamed, settings: StreamSettings) -> StreamRace:
    """Another race on the same stream."""
    race = StreamRace(streamed.run, settings, silent)
    race.stream = streamed.stream
    return race


def test_tasks_are_shuffled_anew_in_each_round_by_the_seed(streamed: Streamed) -> None:
    settings = StreamSettings(repeats=2, seed=3)
    field = [
        solvers.registry.describe(entry)
        for entry in solvers.registry.entries()
        if entry.lane in (Lane.KERNEL, Lane.DIRECT) and entry.name in ("box_active_set", "projected_difference")
    ]
    orders = [
        [
            (task.solver, task.lane, task.setting.rung)
            for task in race_of(streamed, settings).tasks(field)
            if task.repeat == repeat and task.solver != "null"
        ]
        for repeat in range(2)
    ]
    assert sorted(orders[0]) == sorted(orders[1])
    assert orders[0] != orders[1]
    again = list(race_of(streamed, settings).tasks(field))
    assert again == list(race_of(streamed, settings).tasks(field))
    assert len({task.key for task in again}) == len(again)
    assert again != list(race_of(streamed, replace(settings, seed=4)).tasks(field))


def test_a_row_says_on_what_grounds_its_setting_was_chosen(streamed: Streamed) -> None:
    assert streamed.row("daqp").basis == "reference"
    assert set(streamed.rows[streamed.rows.solver.isin([*FAULTS, "times_itself"])].basis) == {"untested"}


def test_one_process_answers_for_several_tiers_each_with_its_grounds(streamed: Streamed) -> None:
    settings = StreamSettings(solvers=("box_active_set",), tiers=(Tier.DEFAULT, Tier.LOW, Tier.EXACT))
    field = [solvers.registry.describe(solvers.find("box_active_set", "direct"))]
    race = race_of(streamed, settings)
    floor, task = race.tasks(field)
    assert floor.basis == {Tier.DEFAULT: "default"}
    assert task.basis == {Tier.DEFAULT: "default", Tier.LOW: "reference", Tier.EXACT: "reference"}
    rows = race.rows(task, Outcome("crashed", "gone"))
    assert [(row["tier"], row["basis"], row["status"]) for row in rows] == [
        ("default", "default", "crashed"),
        ("low", "reference", "crashed"),
        ("exact", "reference", "crashed"),
    ]


def test_a_method_of_steps_has_a_row_for_each_number_of_them_though_its_process_crashed(streamed: Streamed) -> None:
    field = [solvers.registry.describe(solvers.find("projected_difference", "kernel"))]
    race = race_of(streamed, StreamSettings())
    rows = [
        row
        for task in race.tasks(field)
        if task.solver != "null"
        for row in race.rows(task, Outcome("crashed", "gone"))
    ]
    assert {row["basis"] for row in rows} == {"each"}
    assert sorted(row["settings"] for row in rows) == sorted(
        f'{{"steps": {steps}}}' for steps in (1, 10, 100, 1000, 15200)
    )


# Figures and report.


def paced_row(solver: str, samples: int, missed: int, stalls: int, **more: Any) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(STREAM.columns, float("nan"))
    return {
        **row,
        "task": solver,
        "solver": solver,
        "lane": "direct",
        "tier": "high",
        "setting": "{}",
        "basis": "reference",
        "settings": "{}",
        "repeat": 0,
        "status": "ok",
        "message": "",
        "paced": True,
        "samples": samples,
        "solves": samples,
        "stopped": "",
        "missed": missed,
        "stalls": stalls,
        "unanswered": 0,
        **more,
    }


def summary_of(rows: list[dict[str, Any]], **response: np.ndarray) -> pd.DataFrame:
    times = [
        {"task": task, "what": what, "ns": (1e3 * us).astype(np.int64)}
        for task, us in response.items()
        for what in ("service", "response")
    ]
    return stream_figures.summary(pd.DataFrame(rows), pd.DataFrame(times, columns=["task", "what", "ns"]))


def test_misses_count_beyond_what_the_machine_itself_may_miss() -> None:
    rows = [
        paced_row("null", 30_000, 30, 30),
        paced_row("as_the_machine", 30_000, 40, 40),
        paced_row("worse", 30_000, 60, 60),
    ]
    table = summary_of(rows).set_index("solver")
    bound = 30_000 * stream_figures.rate_bound(30, 30_000)
    assert 40 < bound < 42
    assert table.missed_beyond_floor.to_dict() == {"null": 0, "as_the_machine": 0, "worse": 60 - 41}
    assert table.status.to_dict() == {"null": "null", "as_the_machine": "ok", "worse": "late"}
    assert table.keeps_up.to_dict() == {"null": True, "as_the_machine": True, "worse": False}


def test_misses_that_come_together_bound_the_machine_less_tightly() -> None:
    alone = stream_figures.floor_bound(pd.DataFrame([paced_row("null", 30_000, 30, 30)]))
    together = stream_figures.floor_bound(pd.DataFrame([paced_row("null", 30_000, 30, 3)]))
    assert alone == stream_figures.rate_bound(30, 30_000)
    assert together == pytest.approx(10 * stream_figures.rate_bound(3, 30_000))
    assert together > alone
    assert stream_figures.floor_bound(pd.DataFrame([paced_row("null", 3_000, 0, 0)])) == stream_figures.rate_bound(
        0, 3_000
    )


@pytest.mark.parametrize(("missed", "says"), [(50, False), (51, True)])
def test_a_machine_that_misses_deadlines_itself_makes_the_verdict_say_so_first(missed: int, says: bool) -> None:
    rows = [paced_row("null", 5000, missed, missed), paced_row("daqp", 5000, 0, 0)]
    table, settings = summary_of(rows, null=np.ones(5000), daqp=np.ones(5000)), {"samples": 5000, "give_up": 0}
    said = stream_figures.verdict(table, settings)
    assert said[0].startswith("This run cannot say who keeps the schedule") == says
    assert any("solver lane keeps the schedule" in sentence for sentence in said) != says
    assert table.keeps_up[table.solver == "daqp"].item() != says
    schedule = {row[0]: row[3] for row in report.report_of(table, settings).table.rows}
    assert schedule == {"null": "floor", "daqp": "unknown" if says else "kept"}


@pytest.mark.parametrize(
    ("basis", "shown"), [("reference", "high"), ("untested", "high, untested"), ("not reached", "high, not reached")]
)
def test_every_table_marks_a_setting_that_no_run_stands_for(basis: str, shown: str) -> None:
    rows = [paced_row("null", 5000, 0, 0, tier="default", basis="default"), paced_row("daqp", 5000, 0, 0, basis=basis)]
    found = report.report_of(summary_of(rows, null=np.ones(5000), daqp=np.ones(5000)), {"samples": 5000, "give_up": 0})
    for table in (found.table, *found.tables[:3]):
        assert [row[2] for row in table.rows] == ["default", shown]
    assert found.summary.set_index("solver").basis.to_dict() == {"null": "default", "daqp": basis}


def test_a_tail_that_reaches_into_the_floor_is_marked_and_an_unsupported_one_refused() -> None:
    generator = np.random.default_rng(5)
    floor = generator.exponential(1.0, 5000)
    rows = [paced_row(name, 5000, 0, 0) for name in ("null", "near", "far")]
    table = summary_of(rows, null=floor, near=floor + np.where(floor > 3.0, 0.0, 2.0), far=floor + 50.0)
    lines = table.set_index("solver")
    assert lines["at_floor_p50"].to_dict() == {"null": True, "near": False, "far": False}
    assert lines["at_floor_p99.9"].to_dict() == {"null": True, "near": True, "far": False}
    assert np.isnan(lines["response_p99.99_us"].to_numpy()).all()
    responses = report.report_of(table, {"samples": 5000, "give_up": 0}).tables[0]
    cells = {row[0]: row[4:8] for row in responses.rows}
    assert cells["near"][2].endswith("≈ floor")
    assert not cells["far"][2].endswith("≈ floor")
    assert {row[3] for row in cells.values()} == {"needs 29956"}


def test_the_farthest_percentile_of_a_compiled_loop_counts_what_would_have_waited_behind_its_long_calls() -> None:
    us = np.random.default_rng(3).lognormal(4.0, 1.0, 30_000).round(3)
    waited = []
    for value in us:
        while value > 125.0:
            waited.append(value)
            value -= 125.0
        waited.append(value)
    loop = paced_row("loop", 30_000, 0, 0, paced=False)
    for row, size, shown in ((loop, us.size, None), (loop, 29_955, "needs 29956")):
        table = summary_of([row | {"samples": size}], loop=us[:size])
        (cells,) = report.report_of(table, {"samples": 200, "give_up": 0}).tables[3].rows
        expected = number(np.quantile(waited, 0.9999, method="inverted_cdf"))
        assert cells[4 + len(QUANTILES) + 1] == (shown or expected)
    assert len(waited) > us.size


def says_who_keeps_it(rows: pd.DataFrame) -> str:
    """What the verdict of a run on this machine has to say, by what the machine itself missed."""
    floor = rows[rows.solver == "null"]
    unfit = floor.missed.sum() > 0.01 * floor.samples.sum()
    return (
        "This run cannot say who keeps the schedule: the machine itself misses"
        if unfit
        else ("solver lanes keep the schedule of 8 kHz")
    )


def test_the_report_begins_with_the_verdict_holds_every_lane_and_is_the_same_when_written_again(
    streamed: Streamed,
) -> None:
    _, path = kind_of(streamed.run).write(streamed.run)
    text = path.read_text(encoding="utf-8")
    assert says_who_keeps_it(streamed.rows) in text.split("![")[0]
    assert "The machine itself, a solver that answers at once on the same schedule, misses" in text
    assert "needs 29956" in text
    assert "no compiled loop over rows" in text
    for name in (*FAULTS, "daqp", "null"):
        assert f"| {name} | direct |" in text
    summary = pd.read_csv(streamed.run.path / "summary.csv")
    assert summary.samples.sum() == streamed.rows.samples.sum()
    before = {
        name: (streamed.run.path / name).read_bytes() for name in ("report.md", "latency_tails.svg", "summary.csv")
    }
    assert all(before.values())
    kind_of(streamed.run).write(streamed.run)
    assert {name: (streamed.run.path / name).read_bytes() for name in before} == before


# The command line.


@pytest.mark.slow
def test_a_stream_that_is_killed_is_resumed_keeps_what_was_done_and_draws_it(
    piezobench: CommandLine, browser: Browser, tmp_path: Path
) -> None:
    run, names = Run(tmp_path / "stream"), ("daqp", "recursive_active_set", "projected_difference")
    resumed = killed_and_resumed(
        piezobench,
        run,
        "response",
        2,
        "race",
        "--race",
        "stream",
        "--samples",
        200,
        "--lane",
        "direct",
        *(word for name in names for word in ("--solver", name)),
        "--out",
        tmp_path,
        "--name",
        "stream",
    )
    rows, times = run.rows(STREAM), run.times()
    assert says_who_keeps_it(rows) in " ".join(resumed.call.stdout.split())
    assert set(rows.solver) == {"null", *names}
    assert rows.task.is_unique
    for task, response in resumed.kept.items():
        again = times[(times.task == task) & (times.what == "response")].ns.iloc[0]
        assert np.array_equal(again, response)
    assert "is finished already" in piezobench("resume", run.path).stdout
    assert piezobench("report", run.path).status == 0
    assert browser.sections(run.path / "report.html") == ["latency_tails", "deadline_profile"]
    for name, x in (("deadline_profile", "periods"), ("latency_tails", "one_in")):
        lines = pd.read_csv(run.path / "figures" / f"{name}.csv")
        assert lines.name.str.contains("steps 15200").any()
        assert not lines.duplicated(["view", "name", x]).any()  # each line has a name of its own
