"""A faulty solver affects its own rows, and no others.

Every faulty solver is right on raw data, so its second row shows that the next task got a working process.
"""

import re
from pathlib import Path

import faulty_solvers
import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine, command_lines
from measured_rows import form_of
from qpsolvers import Problem
from recording_files import text_file
from small_races import Race

from bench.messages.task import NO_SETTING, ChildSettings, RaceError, Status, Task, Tier
from bench.processes.solver_child import SolverChild, entry_of_file
from bench.races import worker
from bench.races.lanes import checked
from bench.races.measuring import set_up
from bench.races.settings import RaceSettings

STATUS = {
    "segfaults": Status.CRASHED,
    "aborts": Status.CRASHED,
    "exits": Status.CRASHED,
    "hangs": Status.TIMED_OUT,
    "hoards": Status.OUT_OF_MEMORY,
    "raises": Status.ADAPTER_FAILED,
    "raises_in_setup": Status.ADAPTER_FAILED,
    "raises_in_update": Status.ADAPTER_FAILED,
    "answers_nan": Status.MISSED,
    "lies": Status.ANSWERED,
    "infeasible": Status.ANSWERED,
    "short": Status.MISSED,
    "nothing": Status.ANSWERED,
    "odd_duals": Status.ADAPTER_FAILED,
    "writes": Status.ANSWERED,
    "writes_later": Status.ANSWERED,
    "unrepeatable": Status.ANSWERED,
    "noisy": Status.ANSWERED,
    "unsupported": Status.UNSUPPORTED,
    "boasts": Status.ANSWERED,
    "miscounts": Status.ANSWERED,
    "answers_complex": Status.ADAPTER_FAILED,
    "prints_much": Status.ANSWERED,
    "starts_others": Status.ANSWERED,
    "babbles": Status.TIMED_OUT,
    "forks": Status.ANSWERED,
    "closes_descriptors": Status.CRASHED,
    "starts_threads": Status.ANSWERED,
    "ignores_signals": Status.TIMED_OUT,
}
SAID = {
    "nothing": "says 'as I say'",
    "segfaults": "SIGSEGV",
    "aborts": "SIGABRT, after printing 'about to fall'",
    "exits": "exit status 3",
    "hangs": "no answer within 4 s",
    "ignores_signals": "no answer within 4 s",
    "babbles": "no answer within 4 s",
    "hoards": "memory limit",
    "raises": "RuntimeError: a | b",
    "raises_in_setup": "KeyError: 'no such setting'",
    "raises_in_update": "ValueError: cannot update",
    "answers_nan": "says 'as I say', and gives no finite answer of 18 numbers",
    "short": "says 'as I say', and gives no finite answer of 18 numbers",
    "odd_duals": "duals z_box: expected shape (18,), got (3,)",
    "unsupported": "takes no | scaled data",
    "answers_complex": "its answer must hold real numbers, not complex128",
}


def row_of(race: Race, name: str, scaling: str = "scaled") -> pd.Series:
    (row,) = (row for _, row in race.hot.iterrows() if (row.solver, row.scaling) == (name, scaling))
    return row


@pytest.mark.parametrize("name", faulty_solvers.FAULTS)
def test_a_faulty_solver_gets_the_status_of_its_fault_and_the_task_after_it_a_process_that_works(
    faulty_race: Race, name: str
) -> None:
    row, after = row_of(faulty_race, name), row_of(faulty_race, name, "raw")
    assert row.status == STATUS[name]
    assert SAID.get(name, "") in row.message
    assert (row.message == "") == (row.status == Status.ANSWERED and name not in SAID)
    assert "\n" not in row.message
    assert (after.status, after.mutates_input, after.repeatable) == (Status.ANSWERED, False, True)


def test_the_race_ends_with_1_and_a_last_line_that_names_the_users_own_lanes_that_fail_or_err(
    faulty_race: Race, clean_race: Race
) -> None:
    *_, last = faulty_race.call.stdout.splitlines()
    wrong = {name for name, status in STATUS.items() if status != Status.ANSWERED} | {"lies", "infeasible"}
    assert {name for name in STATUS if f" {name} (direct) " in last} == wrong, last
    assert "segfaults (direct) fails on 1 of 1 problems, first on bouc_wen-staircase: the process ended with " in last
    assert "lies (direct) has an error of " in last
    assert (faulty_race.call.status, clean_race.call.status) == (1, 0)


@pytest.mark.parametrize(("name", "figure"), [("lies", "cost_gap"), ("infeasible", "violation")])
def test_a_wrong_answer_is_measured_and_misses_every_tier(faulty_race: Race, name: str, figure: str) -> None:
    assert row_of(faulty_race, name)[figure] > 1e-2
    settings, rows = (
        table.query(f"solver == '{name}' and scaling == 'scaled'")
        for table in (faulty_race.found.settings, faulty_race.found.rows_at_tiers)
    )
    assert (settings.setting == "").all()
    assert rows[["tier", "right", "status"]].to_numpy().tolist() == [[Tier.DEFAULT, False, Status.MISSED]]


@pytest.mark.parametrize("name", ["boasts", "miscounts"])
def test_impossible_counts_and_times_are_empty_in_the_table(faulty_race: Race, name: str) -> None:
    row = row_of(faulty_race, name)
    assert (row.iterations, np.isnan(row.reported_us)) == (-1, True)


def test_faulty_solvers_do_not_change_the_rows_of_others(clean_race: Race, faulty_race: Race) -> None:
    columns = [
        "task",
        "status",
        "message",
        "cost_gap",
        "violation",
        "primal_residual",
        "dual_residual",
        "duality_gap",
        "weight_error",
        "model_error_percent",
        "iterations",
        "mutates_input",
        "repeatable",
    ]
    others = faulty_race.hot[faulty_race.hot.solver.isin(["daqp", "osqp"])]
    assert len(others) == 3 + 8 + 2  # the settings of both on scaled data, and their defaults on raw
    pd.testing.assert_frame_equal(
        others[columns].reset_index(drop=True),
        clean_race.hot.loc[clean_race.hot.task.isin(others.task), columns].reset_index(drop=True),
        check_exact=True,
    )


def test_only_solvers_that_write_into_their_input_or_give_other_bits_again_are_marked(faulty_race: Race) -> None:
    rows = faulty_race.rows[faulty_race.rows.scaling == "scaled"]  # those on raw data are tested one by one
    assert set(rows.solver[rows.mutates_input]) == {"writes", "writes_later"}
    assert set(rows.solver[~rows.repeatable]) & set(STATUS) == {"unrepeatable"}


def test_a_solver_that_ran_has_times_and_one_that_failed_has_none(faulty_race: Race) -> None:
    rows = faulty_race.rows
    answered = ~rows.status.isin([Status.CRASHED, Status.TIMED_OUT, Status.OUT_OF_MEMORY, Status.UNSUPPORTED])
    answered &= ~(rows.solver.str.startswith(("raises", "answers_complex")) & (rows.scaling == "scaled"))
    assert rows.solve_us_p50.notna().equals(answered)


def test_output_of_solvers_does_not_reach_the_terminal(faulty_race: Race) -> None:
    assert ("noise noise" in faulty_race.call.stdout, faulty_race.call.stderr) == (False, "")


def test_processes_that_a_solver_started_end_with_it(faulty_race: Race) -> None:
    everyone = command_lines(int(process.name) for process in Path("/proc").glob("[0-9]*"))
    assert sum("pytest" in line for line in everyone) > 0
    assert not [line for line in everyone if f"tail -f {faulty_race.run.path.parent}" in line]


@pytest.mark.parametrize(
    "sleeps",
    [
        pytest.param("note(os.getpid()); ctypes.PyDLL(None).pause()", id="a solver that holds the interpreter"),
        pytest.param(
            "note(subprocess.Popen(['sleep', '1001']).pid); time.sleep(1000)", id="a process that a solver started"
        ),
    ],
)
def test_neither_a_sleeping_process_nor_a_temporary_file_outlives_a_killed_race(
    piezobench: CommandLine, tmp_path: Path, sleeps: str
) -> None:
    before = {*piezobench.folder.rglob("*piezobench*")}
    note = "\n\ndef note(pid):\n    open(__file__ + '.pid', 'w').write(str(pid))\n"
    file = faulty_solvers.written(tmp_path, "sleeper", "solve(self)", sleeps, note)
    words = ("--set", "paper", "--limit", 1, "--lane", "kernel", "--solver", "box_active_set", "--time-limit", 60)
    call = piezobench.start("race", *words, "--solver", file, "--out", tmp_path)
    pid = tmp_path / "sleeper.py.pid"
    ended = call.kill_once(lambda: pid.exists() and pid.read_text() != "")  # which waits for all processes to end
    assert pid.read_text(), ended.stderr
    assert {*piezobench.folder.rglob("*piezobench*")} == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("raise OSError('no licence here')", "cannot be loaded, OSError: no licence here"),
        ("import ctypes; ctypes.string_at(0)", "ended the process that loaded it with SIGSEGV"),
        ("def (", "cannot be loaded, SyntaxError"),
        ("import a_module_that_is_not_there", "No module named 'a_module_that_is_not_there'"),
        ("", "must define one Solver class, and defines 0"),
        (
            "import solvers\nclass Mine(solvers.Solver):\n    def solve(self, warm_start=None):\n        pass",
            "its class Mine lacks setup and solution and update",
        ),
        (faulty_solvers.text("mine").replace("Lane.DIRECT", "'fast'"), "'fast' is not a valid Lane"),
        (faulty_solvers.text("mine").replace('"MIT"', "'MIT'; exponents = 'all'"), "could not convert string to float"),
        (faulty_solvers.text("mine").replace('"MIT"', "'MIT'; ladder = 9"), "cannot be loaded, TypeError"),
        (faulty_solvers.text("daqp"), "there is a solver daqp already"),
        (faulty_solvers.text("null"), "there is a solver null already"),
        (
            faulty_solvers.text("box_active_set").replace("Lane.DIRECT", "Lane.QPSOLVERS"),
            "there is a solver box_active_set already",
        ),
        (faulty_solvers.text("../daqp"), "a solver is named with letters"),
    ],
)
def test_a_file_that_cannot_be_raced_is_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    path = text_file(tmp_path, text, name="mine.py")
    with pytest.raises(RaceError, match=rf"\A[^\n]*{path}[^\n]*{re.escape(message)}[^\n]*\Z"):
        checked(RaceSettings(solvers=("daqp",), solver_files=(str(path),)))


def test_a_crashed_child_has_the_same_description(tmp_path: Path) -> None:
    entry = entry_of_file(faulty_solvers.written(tmp_path, "exits", *faulty_solvers.FAULTS["exits"]))
    task = Task("none", "none", "scaled", entry.name, entry.lane, NO_SETTING)
    with SolverChild(entry) as child:
        before = child.describe()
        lost = child.ask(worker.set_up, task, {"P": np.eye(2), "q": np.array([-1.0, 1.0]), "lb": np.zeros(2)})
        assert (before.absent, lost.failure) == ("", Status.CRASHED)
        assert child.describe() == before


def test_a_set_up_that_eats_the_time_limit_is_called_set_up(tmp_path: Path) -> None:
    entry = entry_of_file(faulty_solvers.written(tmp_path, "prepares", "setup(self)", "time.sleep(1000)"))
    form = form_of(Problem(np.eye(2), np.array([-1.0, 1.0]), lb=np.zeros(2), ub=np.ones(2)))
    with SolverChild(entry, ChildSettings(time_limit_s=0.5)) as child:
        lost = set_up(child, Task("none", "none", "scaled", entry.name, entry.lane, NO_SETTING), form)
    assert (lost.failure, lost.message) == (Status.TIMED_OUT, "its set-up gave no answer within 0.5 s")
