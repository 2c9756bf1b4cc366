"""Which orders n and m a recording supports, by cross-validation.

The counted samples are cut into FOLDS stretches of equal length, since neighbours in time know of each other. The cost (6) is a
sum over samples, so one pass of the operators gives P, q and c of every stretch, and for each of them the weights come from the
sum over all others. The error (5) on the stretch that was left out, RMS, is that of the order; of all orders whose error is
within one standard error of the smallest, the one with the fewest unknowns is taken.

Source: T. Hastie, R. Tibshirani and J. Friedman, The Elements of Statistical Learning, 2nd edition 2009, section 7.10.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from piezo_model.data_basis import DataBasis
from piezo_model.identification.counting import moving_from
from piezo_model.identification.fitting import IdentificationError, optimum
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.model import HysteresisCreepModel
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.structure import ModelStructure

FOLDS = 5
HYSTERESIS_ORDERS = (1, 2, 3, 5, 8, 12)
SUPERPOSITION_ORDERS = (0, 1, 2, 3, 5)
MISFIT_PERCENT = 1.0
"""Error of the smallest order from which on larger ones that err more speak against the model class."""
SAMPLES = 200_000
"""Samples that are looked at, from where the drive moves."""


@dataclass(frozen=True)
class Order:
    """Orders with their cross-validated error."""

    n: int
    m: int
    d: int
    """Orders and number of unknowns."""
    error_percent: float
    standard_error: float
    """RMS error (5) on data left out, per cent of the input's range, and its standard error over the stretches."""


@dataclass(frozen=True)
class OrderSelection:
    """All orders that were looked at, and the one to take."""

    orders: tuple[Order, ...]
    best: Order
    """With the smallest error."""
    chosen: Order
    """With the fewest unknowns within one standard error of it."""

    @property
    def misfit(self) -> bool:
        """Whether the error on data left out rises with the order, from the smallest one on and by far more than its standard error."""
        fewest, most = (f(self.orders, key=lambda order: order.d) for f in (min, max))
        return (self.best == fewest and len(self.orders) > 1
                and most.error_percent > fewest.error_percent + 2.0 * max(fewest.standard_error, most.standard_error)
                and fewest.error_percent > MISFIT_PERCENT)

    @property
    def sentence(self) -> str:
        """The choice in words."""
        c, b = self.chosen, self.best
        if self.misfit:
            return (f"The model class does not fit: of {len(self.orders)} orders the fewest unknowns, n = {c.n}, m = {c.m}, predict data "
                    f"left out best, with an error of {c.error_percent:.3f} % of the input's range, and more only make it worse.")
        text = (f"Cross-validation over {len(self.orders)} orders takes n = {c.n}, m = {c.m} ({c.d} unknowns): an error of "
                f"{c.error_percent:.3f} % of the input's range on data left out")
        return text + ("." if c == b else (
            f", within one standard error of the smallest, {b.error_percent:.3f} % with n = {b.n}, m = {b.m}."))


def select_order(recording: Recording, model: HysteresisCreepModel, solver: str = "box_active_set",
                 ns: Sequence[int] = HYSTERESIS_ORDERS, ms: Sequence[int] = SUPERPOSITION_ORDERS,
                 progress: Callable[[str, int, int], None] = lambda what, done, total: None) -> OrderSelection:
    """Cross-validate orders.

    Parameters
    ----------
    recording : Recording
    model : HysteresisCreepModel
        Of a first fit: ranges, creep rates, offset and start are kept, the orders are replaced.
    solver : str
    ns, ms : sequence of int
        Orders to look at.
    progress : function of (what, done, total), optional

    Raises
    ------
    IdentificationError
        The recording is too short for any of the orders.
    """
    structure, start, skip = model.structure, model.start, int(model.report["fit"]["skipped"])
    x, y = recording.head(moving_from(recording, skip) + SAMPLES).arrays()
    grid = [with_orders(structure, n, m) for n, m in product(ns, ms)]
    length = (x.size - skip) // FOLDS
    grid = [s for s in grid if s.d < length]
    if not grid:
        raise IdentificationError(f"{recording.name}: {x.size - skip} samples after the start are too few for cross-validation")
    found = []
    for done, s in enumerate(grid):
        progress(f"n = {s.n}, m = {s.dead_zones // 2}", done, len(grid))
        state = OperatorState.at_rest(s) if start is None else start.on(structure, s)
        errors = _errors(x, y, s, skip, length, state, solver)
        rms = float(np.sqrt(np.mean(errors**2)))
        spread = float(np.std(errors**2, ddof=1) / np.sqrt(FOLDS)) / (2.0 * rms) if rms else 0.0
        scale = 100.0 * structure.x_scale / (recording.x_range[1] - recording.x_range[0])
        found.append(Order(s.n, s.dead_zones // 2, s.d, scale * rms, scale * spread))
    best = min(found, key=lambda order: order.error_percent)
    good = [order for order in found if order.error_percent <= best.error_percent + best.standard_error]
    return OrderSelection(tuple(found), best, min(good, key=lambda order: (order.d, order.error_percent)))


def with_orders(s: ModelStructure, n: int, m: int) -> ModelStructure:
    """The structure with other orders, thresholds equidistant."""
    other = ModelStructure.equidistant(n, m, (-1.0, 1.0), (-1.0, 1.0), (), s.sample_time)
    return replace(s, play_thresholds=other.play_thresholds, dead_zone_thresholds=other.dead_zone_thresholds)


def _errors(x: np.ndarray, y: np.ndarray, s: ModelStructure, skip: int, length: int, state: OperatorState,
            solver: str) -> np.ndarray:
    """RMS error (5) in unit amplitudes on each stretch, from the weights of all others, shape (FOLDS,)."""
    basis = DataBasis(s, state)
    basis.update(x[:skip], y[:skip], count=False)
    stretches = []
    for fold in range(FOLDS):
        part = slice(skip + fold * length, skip + (fold + 1) * length)
        basis.update(x[part], y[part])
        stretches.append(basis.problem())
        basis.clear()
    errors = []
    for fold, left_out in enumerate(stretches):
        w = optimum(_mean([each for i, each in enumerate(stretches) if i != fold]), solver)
        errors.append(np.sqrt(max(2.0 * left_out.cost(w), 0.0)))
    return np.array(errors)


def _mean(parts: Sequence[IdentificationProblem]) -> IdentificationProblem:
    """The problem of several stretches of equal length."""
    seen = [part.excitation for part in parts]
    return IdentificationProblem(
        parts[0].structure, np.mean([part.P for part in parts], axis=0), np.mean([part.q for part in parts], axis=0),
        float(np.mean([part.c for part in parts])),
        Excitation(min(e.x_min for e in seen), max(e.x_max for e in seen), min(e.y_min for e in seen), max(e.y_max for e in seen),
                   tuple(map(any, zip(*(e.play_moved for e in seen), strict=True))),
                   tuple(map(any, zip(*(e.creep_moved for e in seen), strict=True)))))
