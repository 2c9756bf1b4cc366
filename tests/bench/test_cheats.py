"""No way to look better than deserved is worth it; each is a solver file that is raced."""

from pathlib import Path

import cheating_solvers
import numpy as np
import pytest
from measured_rows import form_of
from small_races import Race, race_of

from bench.messages.task import NO_SETTING, Outcome, Setting, Status, Task, Tier
from bench.problems.fresh import FreshData, mixture
from bench.problems.protocol import RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races import measuring, null_solver
from bench.races.measuring import row_of, timed
from bench.races.metrics import relative_gap
from bench.timing.clock import Effort
from solvers import Entry, Lane, Problem, find, from_file

RIGHT = {
    "honest",
    "caches",
    "keeps_for_its_other_settings",
    "lazy",
    "patches_the_clock",
    "patches_and_mends",
    "patches_the_message",
    "hooks",
    "rewrites_times",
    "works_ahead",
    "works_ahead_later",
    "works_ahead_at_first",
    "answers_one_at_a_time",
    "works_aside",
    "times_itself",
}
"""Those whose answers are right, so that they gain no more than a part of their time."""
TAMPERED = (
    "looks",
    "looks_into_memory",
    "patches_the_guard",
    "moves_a_folder",
    "sends_by_itself",
    "loses_times",
    "takes_time_back",
    "names_times_anew",
    "counts_beyond_64_bits",
    "has_a_status_of_its_own",
    "calls_itself_not_run",
)


@pytest.fixture(scope="module")
def cheats(tmp_path_factory: pytest.TempPathFactory) -> Race:
    folder = tmp_path_factory.mktemp("cheats")
    return race_of(
        folder,
        "cheats",
        *("--set", "paper", "--limit", 1, "--scaling", "scaled", "--rounds", 0, "--budget", 0.2),
        *("--solver", "daqp", "--lane", "direct", "--lane", "kernel"),
        *(word for path in cheating_solvers.write_all(folder) for word in ("--solver", path)),
    )


@pytest.mark.parametrize("name", cheating_solvers.CHEATS)
def test_no_cheat_is_right_in_less_than_half_the_time_of_the_honest_solver(cheats: Race, name: str) -> None:
    settings = cheats.found.settings[cheats.found.settings.tier != Tier.STAGE]  # which may not notice an older answer
    reached = settings.setting[settings.solver == name] != ""
    assert reached.size
    assert reached.any() == (name in RIGHT), cheats.rows[cheats.rows.solver == name].message.tolist()
    field = cheats.found.lanes.set_index("solver")
    honest = cheats.found.pooled(field.task[["honest"]]).min()  # which other processes disturb least
    assert not reached.any() or field.answer_us[[name]].min() >= honest / 2.0 > 0.0


@pytest.mark.parametrize("name", TAMPERED)
def test_a_process_that_reads_what_it_must_not_or_sends_what_nobody_asked_for_has_tampered(
    cheats: Race, name: str
) -> None:
    assert set(cheats.rows.status[cheats.rows.solver == name]) == {Status.TAMPERED}


def test_a_processor_time_that_calls_do_not_report_is_in_the_table_and_an_honest_one_is_not(cheats: Race) -> None:
    hidden = cheats.rows.groupby("solver").cpu_us.max()
    assert hidden[["rewrites_times", "works_ahead", "works_aside", "patches_the_clock"]].notna().all()
    assert hidden[["honest", "daqp"]].isna().all()


def test_answers_kept_from_one_setting_or_file_are_of_no_use_to_another_and_a_setting_of_any_name_counts_no_steps(
    cheats: Race,
) -> None:
    rows = cheats.rows[cheats.rows.solver == "keeps_for_its_other_settings"]
    shared = cheats.rows[cheats.rows.judged > 0].groupby("draw_seed").solver.nunique()
    assert (len(rows) >= 5, shared.max()) == (True, 2), "only the floor and daqp have the same data"
    assert rows.answer_us.min() > 0.2 * rows.answer_us.max() > 0.0
    np.testing.assert_allclose(rows.periods * rows.period_us, rows.answer_us)


def test_the_judged_answers_of_an_honest_solver_are_those_that_were_timed(cheats: Race) -> None:
    gaps = cheats.rows.groupby("solver").timed_gap
    # Some answers of daqp are outside the bounds by more than its tolerance of 1e-6.
    assert (gaps.max()[["honest", "daqp"]] <= [1e-9, 1e-5]).all()
    assert 0.0 <= gaps.min()["honest"] < gaps.max()["stale"] < np.inf


def test_the_worst_judged_answer_is_stored_with_its_data_and_can_be_judged_again(cheats: Race) -> None:
    rows = cheats.rows[
        (cheats.rows.judged > 0) & (cheats.rows.status == Status.ANSWERED) & np.isfinite(cheats.rows.timed_gap)
    ]
    assert {"tires", "daqp"} <= set(rows.solver)
    problem = cheats.run.problem("paper", rows.problem.iloc[0])
    assert set(rows.digest) == {problem.digest}
    for row in rows.groupby("solver").head(2).itertuples():
        form = mixture(problem.forms[row.scaling], row.timed_shares, row.timed_factors)
        assert max(relative_gap(form, row.timed_answer)) == row.timed_gap
        assert relative_gap(problem.forms[row.scaling], row.answer) == (row.cost_gap, row.violation)


QP = Problem(np.eye(18), -np.linspace(-1.0, 1.0, 18), lb=np.zeros(18), ub=np.full(18, np.inf))
FORM = form_of(QP, cost_unit=1.0)
RANDOMISED = """
def solve(self, warm_start=None):
    for _ in range(1 + np.random.default_rng().integers(3)):
        x = self.right(self.P, self.q)
    return x + np.random.default_rng().uniform(0.0, 1e-15, x.size)
"""
TAILED = """
def solve(self, warm_start=None):
    self.calls += 1
    end = time.process_time_ns() + (100_000_000 if self.calls == 6 else 1_000_000)
    while time.process_time_ns() < end:
        pass
    return self.right(self.P, self.q)
"""


@pytest.mark.parametrize(("solve", "runs"), [(RANDOMISED, 100), (TAILED, 3)])
def test_an_honest_solver_is_right_in_every_run_and_a_slow_call_is_no_median(
    solve: str, runs: int, tmp_path: Path
) -> None:
    file = cheating_solvers.written(tmp_path, "honest", solve)
    problem = RaceProblem("none", "none", {"scaled": FORM})
    task = Task("none", "none", "scaled", "honest", Lane.DIRECT, NO_SETTING)
    with SolverChild(from_file(file)) as child, SolverChild(null_solver.ENTRY) as null:
        for _ in range(runs):
            fresh = FreshData(FORM, 20)
            outcome = timed(child, null, task, FORM, fresh, Effort(0.0, 20, 20))
            row = row_of(problem, task, outcome, fresh, 5, "")
            assert (row["status"], row["judged"]) == (Status.ANSWERED, len(outcome.answers)), row["message"]
            assert max(row["timed_gap"], row["cost_gap"]) <= 1e-9
            assert np.isnan(row["cpu_us"])


COMPILED = """
from time import process_time_ns
from solvers.kernel import box_active_set

class WorksBeside(box_active_set.{cls}):
    name = "works_beside"

    @classmethod
    def ladder(cls, c):
        return ({{"refinements": 1}}, {{"refinements": 2}})

    def __init__(self, **settings):
        super().__init__()

    def time_kernel(self, P, q, *more, **named):
        end = process_time_ns() + {beside_ns} * len(q)
        while process_time_ns() < end:
            pass
        return super().time_kernel(P, q, *more, **named)
"""


@pytest.mark.parametrize("beside_ns", [0, 200_000])
def test_untimed_work_of_a_compiled_solver_counts_by_its_processor_time(
    beside_ns: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "works_beside.py").write_text(
        COMPILED.format(cls=find("box_active_set", "kernel").load().__name__, beside_ns=beside_ns)
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    entry = Entry("works_beside", Lane.KERNEL, "works_beside")
    assert entry.times_itself
    task = Task("none", "none", "scaled", entry.name, entry.lane, Setting('{"refinements": 2}', 1, False))
    with SolverChild(entry) as child, SolverChild(null_solver.ENTRY) as null:
        outcome = timed(child, null, task, FORM, FreshData(FORM, 300), Effort(0.0, 60, 60))
    assert outcome.failure == "", outcome.message
    assert (outcome.cpu_ns == 0.0) == (beside_ns == 0)
    assert beside_ns == 0 or outcome.cpu_ns > 0.5 * beside_ns * len(outcome.answers)


def test_what_calls_hide_is_their_processor_time_beyond_once_that_of_the_null_solver(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def block(cpu_ns: float) -> Outcome:
        ns = np.full(4, 10_000)
        return Outcome(found=True, times={"update": ns, "solve": ns}, answers=np.zeros((4, 18)), cpu_ns=cpu_ns)

    times = iter([2e6, 3e6, 1e6, 4e6, 5e6, 4e6])
    monkeypatch.setattr(measuring, "set_up", lambda *given: Outcome(found=True))
    monkeypatch.setattr(measuring, "run_block", lambda *given: block(next(times)))
    task = Task("none", "none", "scaled", "honest", Lane.DIRECT, NO_SETTING)
    with SolverChild(null_solver.ENTRY) as null:
        null_ns = measuring._null_ns(null, task, FORM, FreshData(FORM, 8), [block(9e6), block(9e6)])
    assert [*null_ns] == [3e6, 5e6], "the longest of three for each block"
    hidden = [measuring.hidden_ns([block(9e6), block(9e6)], own) for own in ([3e6, 5e6], [9e6, 9e6])]
    assert hidden == [10e6 - 2 * measuring.UNSEEN_NS, 0.0]
