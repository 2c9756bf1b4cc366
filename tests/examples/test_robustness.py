"""Learning in situations drawn at random, on a few seeds: near the floor, never worse than the straight line,
repeatable."""

import numpy as np
import pandas as pd
import pytest
import robustness


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return pd.DataFrame([row for seed in (5, 6, 14) for row in robustness.rows(seed)])


def test_every_way_ends_near_the_floor_and_far_from_the_straight_line(rows: pd.DataFrame) -> None:
    assert (rows.cycle_5 < 0.5 * rows.straight).all()
    assert (rows.ratio < 3.0).all()
    assert (rows[rows.way == "continuous"].ratio < 1.5).all()


def test_a_seed_is_the_same_row_again(rows: pd.DataFrame) -> None:
    (again,) = robustness.rows(6, ("cyclic, exact",))
    (before,) = rows[(rows.seed == 6) & (rows.way == "cyclic, exact")].to_dict("records")
    assert again == before
    assert np.isfinite(list(again.values())[4:]).all()
