"""The stream race: real solvers in real processes on the real clock.

No test depends on the speed of the machine; they check that the records are consistent with what happened.
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
from small_races import assert_harmless, killed_and_resumed

from bench.messages.task import Outcome, Status, Tier, silent
from bench.problems.simulation import FORGOTTEN_S
from bench.processes.engine import Workers
from bench.races.kind import kind_of, kinds
from bench.races.stream import report
from bench.races.stream import summary as stream_summary
from bench.races.stream.race import STREAM, StreamRace, StreamSettings
from bench.races.stream.stream_problem import StreamProblem, make
from bench.store import Run
from bench.timing.schedule import PERIOD_NS, Timeline
from solvers import Lane, find
from solvers.registry import Described, describe

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
    "answers_outside": "x = solve_problem(Problem(self.P, self.q, lb=self.lb), solver='daqp').x; "
    "return x - (x <= self.lb + 1e-12)",
    "answers_later": "return type('Later', (), {'__array__': lambda *_, **__: (time.sleep(1e-3), np.zeros(18))[1]})()",
    "asks_for_its_last": "assert self.calls == 1 or np.array_equal(warm_start, self.x), 'another start'",
}
SAMPLES, GIVE_UP = 400, 150


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
        (ns,) = self.times.ns[(self.times.task == row.task) & (self.times.what == what)]
        return np.asarray(ns)

    def timeline(self, row: pd.Series) -> Timeline:
        began, service = self.ns(row, "began"), self.ns(row, "service")
        return Timeline(int(row.samples), self.ns(row, "sample"), self.ns(row, "data"), began, began, began + service)


@pytest.fixture(scope="module")
def streamed(tmp_path_factory: pytest.TempPathFactory) -> Streamed:
    folder = tmp_path_factory.mktemp("stream")
    for name, fault in FAULTS.items():
        (folder / f"{name}.py").write_text(SLOW.format(name=name, fault=fault))
    settings = StreamSettings(
        solvers=("daqp", "box_active_set", "accelerated_projection"),
        lanes=(Lane.KERNEL, Lane.DIRECT),
        samples=SAMPLES,
        give_up=GIVE_UP,
        certified=12,
        repeats=2,
        solver_files=(
            *(str(folder / f"{name}.py") for name in FAULTS),
            str(cheating_solvers.written(folder, "times_itself")),
        ),
    )
    run = kinds()["stream"].start(folder, settings, "run")
    kinds()["stream"].carry_on(run, silent, Workers())
    return Streamed(run, run.rows(STREAM), run.times(), make(settings.experiment, SAMPLES, FORGOTTEN_S, 12))


def test_every_solver_lane_has_a_row_per_process_and_the_floor_is_measured_in_each_round(streamed: Streamed) -> None:
    counts = streamed.rows.groupby(["solver", "lane"]).repeat.nunique()
    assert (counts.drop(index=[("null", "direct")]) == 2).all()
    assert len(counts) == 3 + 3 + 8 + 1  # kernel, direct, the user's, and the machine
    assert counts["null", "direct"] == 4  # fourteen tasks a round, a floor before every ten


def test_misses_and_gaps_of_the_null_solver_follow_from_its_samples(streamed: Streamed) -> None:
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


def test_a_solver_that_sleeps_misses_its_deadlines_and_its_stale_answers_have_a_gap(streamed: Streamed) -> None:
    row = streamed.row("sleeps_1_ms")
    assert row.missed == row.samples
    assert row.solves < row.samples
    assert row.samples >= GIVE_UP
    assert row.stopped == (f"late at each of the first {row.samples} samples" if row.samples < SAMPLES else "")
    assert row.reused == 1.0
    assert row.own_gap_max < 1e-9 < row.gap_max
    assert 0.0 < row.exact_gap_max <= row.gap_max * (1.0 + 1e-6)
    assert row.status == Status.OK  # its answers are right, and late


def test_solves_begin_when_their_sample_is_due_and_response_times_include_waiting(
    streamed: Streamed,
) -> None:
    for _, row in streamed.rows[streamed.rows.samples > 0].iterrows():
        timeline = streamed.timeline(row)
        assert np.all(timeline.began >= timeline.solved * PERIOD_NS)
        includes = np.searchsorted(timeline.solved, np.arange(timeline.samples))
        assert np.all(timeline.response_ns >= timeline.service_ns[includes])
    slow = streamed.timeline(streamed.row("sleeps_1_ms"))
    # Service times do not show the samples that came due meanwhile.
    assert slow.response_ns.sum() > 5 * slow.service_ns.sum()
    assert slow.response_ns.size > 5 * slow.service_ns.size


@pytest.mark.parametrize("lane", ["kernel", "direct"])
@pytest.mark.parametrize("solver", ["daqp", "box_active_set"])
def test_exact_solvers_are_exact_at_the_sample_they_answer(streamed: Streamed, solver: str, lane: str) -> None:
    row = streamed.row(solver, lane)
    assert row.status == Status.OK
    assert row.own_gap_max < 1e-9
    assert row.exact_instants == 12
    assert row.exact_difference < 1e-6
    assert not row.mutates_input
    assert row.solves == streamed.ns(row, "service").size


@pytest.mark.parametrize(
    ("solver", "lane", "status", "least_ns"),
    [
        # It calls another solver five times, and reports a nanosecond.
        pytest.param("times_itself", "kernel", Status.OK, 10_001, id="a user's compiled solver is timed from outside"),
        pytest.param("answers_later", "direct", Status.MISSED, 1_000_000, id="a lazy answer is timed"),
        pytest.param("answers_outside", "direct", Status.MISSED, 0, id="an answer is judged as it is, not clipped"),
        pytest.param("asks_for_its_last", "direct", Status.OK, 0, id="a warm start is the last answer"),
    ],
)
def test_a_users_solver_is_timed_on_the_schedule_until_its_answer_is_an_array(
    streamed: Streamed, solver: str, lane: str, status: Status, least_ns: int
) -> None:
    row = streamed.row(solver, lane)
    assert (row.status, row.message) == (status, "")
    assert streamed.ns(row, "service").min() >= least_ns
    assert row.solves > 1


@pytest.mark.parametrize(
    ("solver", "lane", "status", "message"),
    [
        ("gives_up_later", "direct", Status.ADAPTER_FAILED, "AssertionError: no more"),
        ("too_short", "direct", Status.ADAPTER_FAILED, "ValueError"),
    ],
)
def test_a_failure_is_a_row_with_its_message(
    streamed: Streamed, solver: str, lane: str, status: Status, message: str
) -> None:
    row = streamed.row(solver, lane)
    assert (row.solves, row.missed, row.stalls, row.unanswered, row.exact_instants) == (0, 0, 0, 0, 0)
    assert (row.status, row.samples) == (status, 0)
    assert message in row.message


def test_without_an_answer_the_previous_one_stays_in_use(streamed: Streamed) -> None:
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


def described(*lanes: Lane, name: str) -> list[Described]:
    return [describe(find(name, lane)) for lane in lanes]


def test_tasks_are_shuffled_anew_in_each_round_by_the_seed(streamed: Streamed) -> None:
    settings = StreamSettings(repeats=2, seed=3)
    lanes = (Lane.KERNEL, Lane.DIRECT)
    field = [*described(*lanes, name="box_active_set"), *described(*lanes, name="projected_difference")]
    tasks = list(race_of(streamed, settings).tasks(field))
    first, second = (
        [(t.solver, t.lane, t.setting.rung) for t in tasks if t.repeat == repeat and t.solver != "null"]
        for repeat in range(2)
    )
    assert sorted(first) == sorted(second)
    assert first != second
    assert len({task.key for task in tasks}) == len(tasks)
    assert tasks == list(race_of(streamed, settings).tasks(field))
    assert tasks != list(race_of(streamed, replace(settings, seed=4)).tasks(field))


def test_a_row_states_the_basis_of_its_setting(streamed: Streamed) -> None:
    assert streamed.row("daqp").basis == "reference"
    assert set(streamed.rows[streamed.rows.solver.isin([*FAULTS, "times_itself"])].basis) == {"untested"}


def crashed_rows(streamed: Streamed, settings: StreamSettings, field: list[Described]) -> list[dict[str, Any]]:
    """The rows of all tasks but the floor's if every process crashes."""
    race = race_of(streamed, settings)
    floor, *tasks = race.tasks(field)
    assert floor.basis == {Tier.DEFAULT: "default"}
    return [row for task in tasks for row in race.rows(task, Outcome("crashed", "gone"))]


def test_one_process_has_a_row_for_each_tier_of_its_setting(streamed: Streamed) -> None:
    settings = StreamSettings(solvers=("box_active_set",), tiers=(Tier.DEFAULT, Tier.LOW, Tier.EXACT))
    rows = crashed_rows(streamed, settings, described(Lane.DIRECT, name="box_active_set"))
    assert [(row["tier"], row["basis"], row["status"]) for row in rows] == [
        ("default", "default", "crashed"),
        ("low", "reference", "crashed"),
        ("exact", "reference", "crashed"),
    ]
    assert len({row["task"] for row in rows}) == 1


def test_a_method_of_steps_has_a_row_for_each_number_of_steps(streamed: Streamed) -> None:
    rows = crashed_rows(streamed, StreamSettings(), described(Lane.KERNEL, name="projected_difference"))
    assert {row["basis"] for row in rows} == {"each"}
    assert {row["settings"] for row in rows} == {f'{{"steps": {steps}}}' for steps in (1, 10, 100, 1000, 15200)}
    assert len(rows) == 5


# Summary and report.


def row_of(solver: str, samples: int, missed: int, stalls: int, **more: Any) -> dict[str, Any]:
    return STREAM.row(
        task=solver,
        solver=solver,
        lane="direct",
        tier="high",
        setting="{}",
        basis="reference",
        settings="{}",
        status="ok",
        samples=samples,
        solves=samples,
        missed=missed,
        stalls=stalls,
    ) | {"unanswered": 0, **more}


def summary_of(rows: list[dict[str, Any]], **response: np.ndarray) -> pd.DataFrame:
    times = [
        {"task": task, "what": what, "ns": (1e3 * us).astype(np.int64)}
        for task, us in response.items()
        for what in ("service", "response")
    ]
    return stream_summary.summary(pd.DataFrame(rows), pd.DataFrame(times, columns=["task", "what", "ns"]))


def test_a_solver_is_late_if_its_bouts_are_shown_to_be_more_frequent_than_the_machines_own() -> None:
    rows = [
        row_of("null", 30_000, 200, 30),
        row_of("as_the_machine", 30_000, 900, 40),
        row_of("worse", 30_000, 60, 60),
    ]
    table = summary_of(rows).set_index("solver")
    assert table.status.to_dict() == {"null": "null", "as_the_machine": "ok", "worse": "late"}
    assert table.keeps_up.to_dict() == {"null": True, "as_the_machine": True, "worse": False}
    sentences = {solver: report.bouts(line) for solver, line in table.iterrows()}
    assert sentences["worse"] == "60 bouts of late answers, 1.27 to 3.21 times as often as the machine itself"
    assert sentences["as_the_machine"].startswith("40 bouts of late answers, 0.81 to 2.2")


@pytest.mark.parametrize(
    ("bouts", "sentence"),
    [
        (0, "no bouts of late answers"),
        (3, "3 bouts of late answers, whether more often than the machine itself cannot be told"),
        (10, "10 bouts of late answers, 2.24 to inf times as often as the machine itself"),
    ],
)
def test_what_cannot_be_told_of_bouts_is_said(bouts: int, sentence: str) -> None:
    table = summary_of([row_of("null", 3_000, 0, 0), row_of("daqp", 3_000, bouts, bouts)]).set_index("solver")
    assert report.bouts(table.loc["daqp"]) == sentence
    assert table.keeps_up["daqp"] == (bouts < 10)


@pytest.mark.parametrize(("missed", "unfit"), [(50, False), (51, True)])
def test_too_many_missed_deadlines_of_the_machine_itself_are_stated_first(missed: int, unfit: bool) -> None:
    rows = [row_of("null", 5000, missed, missed), row_of("daqp", 5000, 0, 0)]
    table, settings = summary_of(rows, null=np.ones(5000), daqp=np.ones(5000)), StreamSettings(samples=5000)
    sentences = report.verdict(table, settings)
    assert sentences[0].startswith("This run cannot say who keeps the schedule") == unfit
    assert any("solver lane keeps the schedule" in sentence for sentence in sentences) != unfit
    assert table.keeps_up[table.solver == "daqp"].item() != unfit
    schedule = {row[0]: row[3] for row in report.report_of(table, settings).table.rows}
    assert schedule == {"null": "floor", "daqp": "unknown" if unfit else "kept"}


@pytest.mark.parametrize(
    ("basis", "shown"), [("reference", "high"), ("untested", "high, untested"), ("not reached", "high, not reached")]
)
def test_every_table_marks_an_untested_setting(basis: str, shown: str) -> None:
    rows = [row_of("null", 5000, 0, 0, tier="default", basis="default"), row_of("daqp", 5000, 0, 0, basis=basis)]
    found = report.report_of(summary_of(rows, null=np.ones(5000), daqp=np.ones(5000)), StreamSettings(samples=5000))
    for table in (found.table, *found.tables[:3]):
        assert [row[2] for row in table.rows] == ["default", shown]
    assert found.summary.set_index("solver").basis.to_dict() == {"null": "default", "daqp": basis}


def test_a_percentile_at_the_floor_is_marked_and_an_unsupported_one_is_refused() -> None:
    generator = np.random.default_rng(5)
    floor = generator.exponential(1.0, 5000)
    rows = [row_of(name, 5000, 0, 0) for name in ("null", "near", "far")]
    table = summary_of(rows, null=floor, near=floor + np.where(floor > 3.0, 0.0, 2.0), far=floor + 50.0)
    lines = table.set_index("solver")
    assert lines["at_floor_p50"].to_dict() == {"null": True, "near": False, "far": False}
    assert lines["at_floor_p99.9"].to_dict() == {"null": True, "near": True, "far": False}
    assert np.isnan(lines["response_p99.99_us"].to_numpy()).all()
    responses = report.report_of(table, StreamSettings(samples=5000)).tables[0]
    cells = {row[0]: row[4:8] for row in responses.rows}
    assert cells["near"][2].endswith("≈ floor")
    assert not cells["far"][2].endswith("≈ floor")
    assert {row[3] for row in cells.values()} == {"needs 29956"}


def expected_verdict(rows: pd.DataFrame) -> str:
    """The verdict of a run on this machine, which depends on the machine's own misses."""
    floor = rows[rows.solver == "null"]
    if floor.missed.sum() > 0.01 * floor.samples.sum():
        return "This run cannot say who keeps the schedule: the machine itself misses"
    return "solver lanes keep the schedule of 8 kHz"


def test_the_report_begins_with_the_verdict_lists_every_lane_and_is_reproducible(
    streamed: Streamed,
) -> None:
    _, path = kind_of(streamed.run).write(streamed.run)
    text = path.read_text(encoding="utf-8")
    assert expected_verdict(streamed.rows) in text.split("![")[0]
    assert "The machine itself, a solver that answers at once on the same schedule, misses" in text
    assert "needs 29956" in text
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
def test_a_killed_stream_is_resumed_keeps_its_finished_tasks_and_is_drawn(
    piezobench: CommandLine, browser: Browser, tmp_path: Path
) -> None:
    run, names = Run(tmp_path / "stream"), ("daqp", "box_active_set", "projected_difference")
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
    assert expected_verdict(rows) in " ".join(resumed.call.stdout.split())
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
        assert not lines.duplicated(["view", "name", x]).any()


@pytest.mark.parametrize("labels", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_no_text_of_a_stream_is_evaluated_in_its_report(
    piezobench: CommandLine, browser: Browser, streamed: Streamed, tmp_path: Path, labels: bool
) -> None:
    assert_harmless(piezobench, browser, streamed.run, STREAM, tmp_path, labels)


def test_the_notes_count_the_lanes_that_were_stopped_with_their_service_times_and_say_nothing_where_none_was() -> None:
    lanes = pd.DataFrame({"solver": ["a", "b", "c"], "is_floor": False, "samples": 50})
    lanes["stopped"], lanes["service_p50_us"] = ["late", "late", ""], [200.0, 310.0, 5.0]
    assert report.notes(lanes, StreamSettings(give_up=50)) == [
        "Late at each of the first 50 samples and stopped there: 2 of 3 lanes; their median service times are 200 to "
        "310 µs."
    ]
    assert report.notes(lanes[2:], StreamSettings(give_up=50)) == []
