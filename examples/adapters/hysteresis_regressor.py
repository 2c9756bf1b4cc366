"""A scikit-learn regressor from drive to displacement, based on ``identify``. Run as a script, it chooses the orders by
a grid search.

A column of drive samples in time order is one recording. ``predict`` simulates the model from rest at the centre of the
fitted range; ``score`` includes the first rows, although the states of a real actuator are not known there. Since the
model has memory, rows must not be shuffled: use ``sklearn.model_selection.TimeSeriesSplit`` or ``PredefinedSplit``.
Requires scikit-learn 1.6 or later.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted, validate_data

from piezo_model import ModelStructure, identify, plants
from piezo_model.signals import multi_sine
from solvers.arrays import Vector


class HysteresisRegressor(RegressorMixin, BaseEstimator):
    """The modified Prandtl–Ishlinskii model with creep as a scikit-learn regressor.

    Parameters
    ----------
    n, m : int
        Orders of hysteresis and creep, and of the superposition on each side.
    creep_rates : sequence of float
        Creep rates in 1/s; empty for a model without creep.
    sample_time : float
        Sampling period of the rows in s.
    skip : int, optional
        Samples at the start of a recording that are not counted; by default those of a switch-on transient.
    solver : str
        Any registered solver.
    column : int, optional
        Index of the drive among the columns of X; the others are ignored. By default X has one column.

    Attributes
    ----------
    model_ : HysteresisCreepModel
    n_features_in_ : int
        Columns of X.

    Examples
    --------
    >>> t = np.arange(4000) * 1e-3
    >>> x = 75.0 + 70.0 * np.sin(2 * np.pi * t) * np.exp(-t / 4)
    >>> y = 0.1 * x + 0.02 * np.roll(x, 20)
    >>> regressor = HysteresisRegressor(n=4, m=2, sample_time=1e-3).fit(x[:, None], y)
    >>> bool(regressor.score(x[:, None], y) > 0.99)
    True
    """

    def __init__(
        self,
        n: int = 5,
        m: int = 3,
        creep_rates: Sequence[float] = (),
        sample_time: float = 1e-3,
        skip: int | None = None,
        solver: str = "box_active_set",
        column: int | None = None,
    ) -> None:
        self.n = n
        self.m = m
        self.creep_rates = creep_rates
        self.sample_time = sample_time
        self.skip = skip
        self.solver = solver
        self.column = column

    def __sklearn_tags__(self) -> Tags:
        """Tags of the estimator: random data, which follow no operator, are fitted poorly."""
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True
        return tags

    def fit(self, X: ArrayLike, y: ArrayLike) -> HysteresisRegressor:
        """Identify the model of one recording.

        Parameters
        ----------
        X : array (N, columns)
            Drive in time order.
        y : array (N,)
            Output.

        Raises
        ------
        ValueError
            X has several columns and ``column`` is None, a number is not finite, drive or output never change, or there
            are too few rows for the weights.
        """
        table, output = validate_data(self, X, y, y_numeric=True, ensure_min_samples=2)
        x, y = self._column(table), np.ascontiguousarray(output, dtype=np.float64)
        for name, values in (("X", x), ("y", y)):
            if np.ptp(values) == 0.0:
                raise ValueError(f"{name} never changes, and hysteresis shows in movement only")
        structure = ModelStructure.equidistant(
            n=self.n,
            m=self.m,
            x_range=(float(x.min()), float(x.max())),
            y_range=(float(y.min()), float(y.max())),
            creep_rates=tuple(self.creep_rates),
            sample_time=self.sample_time,
            offset=True,
            input_unit="",
            output_unit="",
        )
        self.model_ = identify(x, y, structure, solver=self.solver, skip=self.skip, force=True)
        return self

    def predict(self, X: ArrayLike) -> Vector:
        """Simulated output (N,) of the drive samples of X (N, columns) in time order."""
        check_is_fitted(self)
        return self.model_.simulate(self._column(validate_data(self, X, reset=False)))

    def _column(self, X: NDArray[np.float64]) -> Vector:
        columns = X.shape[1]
        if self.column is None and columns != 1:
            raise ValueError(
                f"X has {columns} features and must have one, the drive, unless column says which one it is"
            )
        column = 0 if self.column is None else self.column
        if not 0 <= column < columns:
            raise ValueError(f"column must lie between 0 and {columns - 1}, the last column of X, and is {column}")
        return np.ascontiguousarray(X[:, column], dtype=np.float64)


def main() -> None:
    """Choose n and m for a simulated actuator."""
    x = multi_sine(duration_s=6.0, sample_time=1e-3, low=0.0, high=150.0)
    y = plants.get("dense_prandtl_ishlinskii", creep_share=0.0).run(x)
    search = GridSearchCV(
        HysteresisRegressor(sample_time=1e-3), {"n": [1, 4, 8], "m": [0, 2]}, cv=TimeSeriesSplit(n_splits=2)
    )
    search.fit(x[:, None], y)
    for orders, score in zip(search.cv_results_["params"], search.cv_results_["mean_test_score"], strict=True):
        print(f"n = {orders['n']}, m = {orders['m']}: R² = {score:.5f} on data left out")
    print(f"chosen: n = {search.best_params_['n']}, m = {search.best_params_['m']}")


if __name__ == "__main__":
    main()
