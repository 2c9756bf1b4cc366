"""The lane codegen raced by the command: built, judged and timed inside C, and only if selected."""

from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine

from bench.derived.measurements import ONESHOT
from bench.races.settings import RaceSettings
from bench.store import Run
from solvers import Lane, find


@pytest.mark.slow
@pytest.mark.needs("gcc")
def test_embedded_solvers_race_against_certified_optima(piezobench: CommandLine, tmp_path: Path) -> None:
    done = piezobench.run(
        "race",
        "--lane",
        "codegen",
        "--solver",
        "box_active_set",
        "--solver",
        "osqp",
        "--set",
        "paper",
        "--limit",
        1,
        "--scaling",
        "scaled",
        "--budget",
        0.002,
        "--rounds",
        3,
        "--out",
        tmp_path,
        "--name",
        "run",
    )
    run = Run.open(tmp_path / "run")
    rows = run.rows(ONESHOT)
    rows = rows[rows.lane == "codegen"].set_index("solver")
    interleaved, rows = rows[rows.timed == "interleaved"], rows[rows.timed == "hot"]
    assert set(rows.index) == {"box_active_set", "osqp"}
    assert rows.status["box_active_set"] == "ok"
    assert rows.cost_gap["box_active_set"] < 1e-20
    assert sorted(rows.rung["osqp"]) == list(range(-1, len(find("osqp", "codegen").load().ladder(1.0))))
    assert rows.cost_gap["osqp"].min() < 1e-5
    assert (rows.update_us > 0).all()
    assert interleaved.answer_us["box_active_set"] > 0
    # at one setting, and none where that takes over a millisecond
    assert (interleaved.index == "osqp").sum() <= 1
    assert np.isfinite(rows.solve_us_p50).all()
    versions = run.settings["field"]
    assert all("-O3 -march=native -ffp-contract=fast" in versions[f"{name} (codegen)"] for name in set(rows.index))
    assert "codegen" in done.stdout


def test_a_race_without_lanes_builds_nothing() -> None:
    assert RaceSettings().lanes == (Lane.KERNEL, Lane.DIRECT, Lane.QPSOLVERS, Lane.CVXPY)
