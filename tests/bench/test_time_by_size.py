"""The table and the plot of time against the number of unknowns."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.races.oneshot import charts, plot_data
from bench.report import svg
from solvers import Status

SPEED = {"box_active_set": 1.0, "recursive_active_set": 2.0, "a": 3.0, "b": 4.0, "c": 5.0, "d": 6.0, "e": 7.0, "f": 8.0}


@pytest.fixture
def rows() -> pd.DataFrame:
    """Solvers whose time is a multiple of d, in two lanes; "a" is wrong at the largest size."""
    return pd.DataFrame([
        {"problem_set": "orders", "scaling": "scaled", "problem": f"d{d}", "d": d, "solver": solver, "lane": lane, "tier": "high",
         "start": "cold", "settings": "{}", "update_us": 0.0, "solve_us_p50": speed * d * (1.0 if lane == "direct" else 1.5),
         "status": Status.MISSED if solver == "a" and d == 60 else Status.OK, "cost_gap": 0.0}
        for solver, speed in SPEED.items() for lane in ("direct", "qpsolvers") for d in (8, 18, 60)])


def test_our_solvers_stand_first_and_the_five_fastest_others_follow_in_their_fastest_lane(rows: pd.DataFrame) -> None:
    table = plot_data.time_by_size(rows)
    assert table.name.tolist()[:4] == ["box_active_set† (direct)", "box_active_set† (qpsolvers)",
                                       "recursive_active_set† (direct)", "recursive_active_set† (qpsolvers)"]
    assert table.name.tolist()[4:] == [f"{solver} (direct)" for solver in "bcdef"]
    assert table[18].iloc[-1] == 8.0 * 18


def test_a_size_with_a_wrong_answer_has_no_time(rows: pd.DataFrame) -> None:
    few = rows[rows.solver.isin(["box_active_set", "a"])]
    line = plot_data.time_by_size(few).set_index("name").loc["a (direct)"]
    assert np.isnan(line[60])
    assert line[8] == 24.0


def test_one_size_gives_no_table(rows: pd.DataFrame) -> None:
    assert len(plot_data.time_by_size(rows[rows.d == 18])) == 0


def test_the_same_table_draws_the_same_file(rows: pd.DataFrame, tmp_path: Path) -> None:
    table = plot_data.sizes(rows)
    for name in ("one.svg", "two.svg"):
        svg.write(charts.sizes(table), tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()
