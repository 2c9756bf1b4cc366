"""The regressor under scikit-learn's own checks, in a grid search, and against ``identify``."""

import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit, cross_val_score
from sklearn.utils.estimator_checks import parametrize_with_checks

from piezo_model import ModelStructure, identify, plants
from piezo_model.estimator import HysteresisRegressor
from piezo_model.signals import multi_sine

Vector = NDArray[np.float64]
SAMPLE_TIME = 1e-3

MEMORY = "a model with creep has memory: what it predicts for a row depends on the rows before"
EXCEPTIONS = {"check_methods_sample_order_invariance": MEMORY, "check_methods_subset_invariance": MEMORY}


def exceptions(regressor: HysteresisRegressor) -> dict[str, str]:
    """None where the noise of the checks, which follows no play operator, leaves a model without memory."""
    return EXCEPTIONS if regressor.creep_rates else {}


@pytest.fixture(scope="module")
def recording() -> tuple[Vector, Vector]:
    x = multi_sine(duration_s=6.0, sample_time=SAMPLE_TIME, low=0.0, high=150.0)
    return x[:, None], plants.get("dense_prandtl_ishlinskii", creep_share=0.0).run(x)


# The checks give several columns and as few as ten rows, so the drive is a chosen column and every row counts.
@parametrize_with_checks([HysteresisRegressor(n=3, m=1, column=0, skip=0),
                          HysteresisRegressor(n=1, m=0, creep_rates=(100.0,), column=0, skip=0)],
                         expected_failed_checks=exceptions, xfail_strict=True)
def test_scikit_learn_finds_nothing_but_what_is_stated(estimator: Any, check: Any) -> None:
    check(estimator)


def test_a_grid_search_over_the_orders_finds_the_larger_model_better(recording: tuple[Vector, Vector]) -> None:
    search = GridSearchCV(HysteresisRegressor(sample_time=SAMPLE_TIME), {"n": [1, 4, 8], "m": [0, 2]},
                          cv=TimeSeriesSplit(n_splits=2), error_score="raise").fit(*recording)
    scores = dict(zip(((p["n"], p["m"]) for p in search.cv_results_["params"]), search.cv_results_["mean_test_score"],
                      strict=True))
    assert search.best_params_ == {"n": 8, "m": 2}
    assert scores[1, 0] < scores[4, 0] < scores[4, 2] < scores[8, 2]
    assert search.best_estimator_.model_.structure.n == 8
    assert search.score(*recording) > 0.99  # the first rows pay for states that predict cannot know


def test_cross_validation_scores_what_was_not_fitted(recording: tuple[Vector, Vector]) -> None:
    scores = cross_val_score(HysteresisRegressor(sample_time=SAMPLE_TIME), *recording, cv=TimeSeriesSplit(n_splits=3),
                             error_score="raise")
    assert scores.shape == (3,)
    assert scores.min() > 0.98


def test_a_clone_has_the_parameters_and_not_the_fit(recording: tuple[Vector, Vector]) -> None:
    regressor = HysteresisRegressor(n=2, sample_time=SAMPLE_TIME).fit(*recording).set_params(n=3, solver="daqp")
    copy = clone(regressor)
    assert copy.get_params() == regressor.get_params() == {
        "n": 3, "m": 3, "creep_rates": (), "sample_time": SAMPLE_TIME, "skip": None, "solver": "daqp", "column": None}
    assert not hasattr(copy, "model_")


def test_the_fit_is_that_of_identify(recording: tuple[Vector, Vector]) -> None:
    X, y = recording
    x = X[:, 0]
    structure = ModelStructure.equidistant(5, 3, (x.min(), x.max()), (y.min(), y.max()), (10.0,), SAMPLE_TIME, offset=True)
    expected = identify(x, y, structure)
    regressor = HysteresisRegressor(creep_rates=(10.0,), sample_time=SAMPLE_TIME).fit(X, y)
    np.testing.assert_array_equal(regressor.model_.weights, expected.weights)
    np.testing.assert_array_equal(regressor.predict(X), expected.simulate(x))


def test_the_chosen_column_is_the_drive(recording: tuple[Vector, Vector]) -> None:
    X, y = recording
    table = np.hstack([np.arange(y.size)[:, None] * SAMPLE_TIME, X])
    found = HysteresisRegressor(column=1, sample_time=SAMPLE_TIME).fit(table, y).predict(table)
    np.testing.assert_array_equal(found, HysteresisRegressor(sample_time=SAMPLE_TIME).fit(X, y).predict(X))


@pytest.mark.parametrize(("column", "sentence"), [
    (None, "X has 2 features and must have one, the drive, unless column says which one it is"),
    (2, "column must lie between 0 and 1, the last column of X, and is 2")])
def test_a_table_without_a_drive_is_refused(recording: tuple[Vector, Vector], column: int | None, sentence: str) -> None:
    X, y = recording
    with pytest.raises(ValueError, match=sentence):
        HysteresisRegressor(column=column).fit(np.hstack([X, X]), y)


def test_a_drive_or_an_output_at_rest_is_refused(recording: tuple[Vector, Vector]) -> None:
    X, y = recording
    with pytest.raises(ValueError, match="X never changes"):
        HysteresisRegressor().fit(np.ones_like(X), y)
    with pytest.raises(ValueError, match="y never changes"):
        HysteresisRegressor().fit(X, np.ones_like(y))


def test_without_scikit_learn_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "piezo_model.estimator")
    monkeypatch.setitem(sys.modules, "sklearn.base", None)
    with pytest.raises(ImportError, match=r"pip install 'piezobench\[ecosystem\]'"):
        import piezo_model.estimator  # noqa: F401
