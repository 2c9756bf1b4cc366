"""The regressor under scikit-learn's own checks, in a grid search, and against ``identify``."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import python, run_example
from programs import ALL, library

from piezo_model import ModelStructure, identify, plants
from piezo_model.signals import multi_sine

library("sklearn")
from hysteresis_regressor import HysteresisRegressor  # noqa: E402
from sklearn.model_selection import TimeSeriesSplit, cross_val_score  # noqa: E402
from sklearn.utils.estimator_checks import check_array_api_input, parametrize_with_checks  # noqa: E402

SAMPLE_TIME = 1e-3


@pytest.fixture(scope="module")
def recording() -> tuple[np.ndarray, np.ndarray]:
    x = multi_sine(duration_s=6.0, sample_time=SAMPLE_TIME, low=0.0, high=150.0)
    return x[:, None], plants.get("dense_prandtl_ishlinskii", creep_share=0.0).run(x)


@pytest.mark.sample(20)
# The checks give several columns and as few as ten rows, so the drive is a chosen column and every row counts.
@parametrize_with_checks(
    [
        HysteresisRegressor(n=3, m=1, column=0, skip=0),
        *[HysteresisRegressor(n=1, m=0, creep_rates=(100.0,), column=0, skip=0)] * ALL,
    ],
    expected_failed_checks=lambda _: dict.fromkeys(
        ("check_methods_sample_order_invariance", "check_methods_subset_invariance"),
        "with hysteresis, an output depends on the inputs before it",
    ),
)
def test_scikit_learn_finds_nothing_but_what_is_stated(estimator: Any, check: Any, tmp_path: Path) -> None:
    if check.func is check_array_api_input:  # SciPy has to hear of it before it is imported
        (tmp_path / "call").write_bytes(pickle.dumps((check, estimator)))
        program = "import pickle, sys; check, estimator = pickle.load(open(sys.argv[1], 'rb')); check(estimator)"
        python("-c", program, tmp_path / "call", SCIPY_ARRAY_API="1")
    else:
        check(estimator)


@pytest.mark.slow
def test_run_alone_it_finds_the_larger_model_better() -> None:
    *lines, chosen = run_example("adapters/hysteresis_regressor.py").splitlines()
    scores = {line.partition(":")[0]: float(line.split()[8]) for line in lines}
    assert scores["n = 1, m = 0"] < scores["n = 4, m = 0"] < scores["n = 4, m = 2"]
    assert chosen == "chosen: n = 4, m = 2"


def test_cross_validation_scores_what_was_not_fitted(recording: tuple[np.ndarray, np.ndarray]) -> None:
    scores = cross_val_score(
        HysteresisRegressor(sample_time=SAMPLE_TIME), *recording, cv=TimeSeriesSplit(n_splits=3), error_score="raise"
    )
    assert scores.shape == (3,)
    assert scores.min() > 0.98


@pytest.mark.parametrize(
    ("column", "table", "output", "sentence"),
    [
        (None, 2, 1.0, "X has 2 features and must have one, the drive, unless column says which one it is"),
        (2, 2, 1.0, "column must lie between 0 and 1, the last column of X, and is 2"),
        (None, 0, 1.0, "X never changes"),
        (None, 1, 0.0, "y never changes"),
    ],
)
def test_a_table_without_a_drive_or_with_anything_at_rest_is_refused(
    recording: tuple[np.ndarray, np.ndarray], column: int | None, table: int, output: float, sentence: str
) -> None:
    X, y = recording
    with pytest.raises(ValueError, match=sentence):
        HysteresisRegressor(column=column).fit(np.hstack([X] * table) if table else np.ones_like(X), output * y)


def test_the_fit_is_that_of_identify(recording: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = recording
    x = X[:, 0]
    structure = ModelStructure.equidistant(
        5, 3, (x.min(), x.max()), (y.min(), y.max()), (10.0,), SAMPLE_TIME, offset=True
    )
    expected = identify(x, y, structure)
    regressor = HysteresisRegressor(creep_rates=(10.0,), sample_time=SAMPLE_TIME).fit(X, y)
    np.testing.assert_equal((regressor.model_.weights, regressor.predict(X)), (expected.weights, expected.simulate(x)))


def test_the_chosen_column_is_the_drive(recording: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = recording
    table = np.hstack([np.arange(y.size)[:, None] * SAMPLE_TIME, X])
    np.testing.assert_array_equal(
        HysteresisRegressor(column=1, sample_time=SAMPLE_TIME).fit(table, y).predict(table),
        HysteresisRegressor(sample_time=SAMPLE_TIME).fit(X, y).predict(X),
    )
