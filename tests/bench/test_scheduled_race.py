"""A race on the schedule of 8 kHz: every answer is judged by its own sample, and late ones are counted."""

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine
from measured_rows import row
from small_races import Race, raced

from bench.derived.measurements import Measurements
from bench.derived.schedule import FLOOR_LINE, KEPT, LATE, UNKNOWN, on_schedule, sentences
from bench.messages.task import Status

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
def race(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> Race:
    folder, files = tmp_path_factory.mktemp("schedule"), list[object]()
    changes: dict[str, dict[str, object]] = {
        "slow": {"sleep": 4e-4},
        "outside": {"wrong": "- 1.0"},
        "forges": {"at_setup": "worker.TimedSolver.scheduled = forged", "forge": FORGE},
    }
    for name, change in changes.items():
        path = folder / f"{name}.py"
        path.write_text(FILE.format(**{"name": name, "at_setup": "", "sleep": 0.0, "wrong": "", "forge": ""} | change))
        files += ["--solver", path]
    return raced(piezobench, folder, "run", *files, "--schedule", SAMPLES, "--scaling", "scaled")


def test_a_solver_gets_the_data_of_each_sample_and_a_slow_one_the_newest(race: Race) -> None:
    rows = race.rows.query("timed == 'scheduled' and solver != 'forges'").set_index("solver")
    assert {"null", "daqp", "slow"} <= set(rows.index)
    assert (rows.due == SAMPLES).all()
    assert (rows.samples <= SAMPLES).all()
    assert rows.samples["slow"] <= SAMPLES / 3
    assert rows.late["slow"] >= 0.9 * SAMPLES
    times = race.run.times().query("timed == 'scheduled'").set_index(["task", "what"]).ns
    for one in rows.itertuples():
        sample, response = times[one.task, "sample"], times[one.task, "response"]
        assert (sample.size, sample[-1]) == (one.samples, SAMPLES - 1)
        assert (np.diff(sample) > 0).all()
        assert (response.size, (response > 125_000).sum()) == (SAMPLES, one.late)


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
    ns = [np.full(3000, 5_000), np.full(3000, 1000 * us)]
    table = on_schedule(Measurements(rows, rows[["task", "timed", "repeat"]].assign(what="response", ns=ns)))
    assert table.set_index("solver").schedule.to_dict() == {"null": FLOOR_LINE, "daqp": expected}
    assert table["p99.9"].tolist() == [5.0, us]
    (sentence,) = sentences(table)
    assert ("cannot say" in sentence) == (expected == UNKNOWN)


def test_a_process_that_answers_samples_that_never_came_has_tampered(race: Race) -> None:
    assert set(race.rows.query("solver == 'forges' and timed == 'scheduled'").status) == {str(Status.TAMPERED)}
