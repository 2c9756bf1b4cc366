"""The quadratic program (6): minimise ½ wᵀP w + qᵀw + c over the admissible weights.

Weights are admissible if w_H ≥ 0, w_K ≥ 0 and the slopes of S⁻¹ are at least ``min_slope``. The slopes are the partial
sums of w'_S outwards from zero, so the set is a box in slope coordinates v = T⁻¹ w, and a polyhedral cone in weight
coordinates. The minimiser is the same in both; the path of a gradient method is not.

Weights that the drive does not excite must keep their values. A proximal term towards reference weights, ½ρ‖v − v_ref‖²
in slope coordinates and normalised units, with ρ = ``proximal`` times the mean diagonal element of P, therefore makes
the problem strictly convex. That is not enough for an operator that never moved: its column is constant, and an offset
or another such column could replace it. So its weight is fixed in the cost of the data, v_i = v_ref,i, and the proximal
term keeps it there. Both are part of the problem in every form.

Forms: ``raw`` has physical units (volts, micrometres, volts per micrometre); ``scaled`` scales the variables of the
normalised problem so that P has a unit diagonal, and a box remains a box. With ‖x̃‖ ≤ 1 the cost is then of order one,
so that a solver's tolerances are meaningful without another factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import solvers
from piezo_model import checks
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector

Coordinates = Literal["slope", "weight"]
Scaling = Literal["scaled", "raw"]

ROUNDING = 1e-11
"""Largest diagonal entry of P, relative to the largest of all, that may be a rounding error."""


@dataclass(frozen=True)
class Excitation:
    """Ranges of input and output over the counted samples, in normalised units, and the operators that moved."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float
    play_moved: tuple[bool, ...]
    """Whether each play of thresholds r_H1 … r_Hn moved."""
    creep_moved: tuple[bool, ...]
    """Whether a creep state of any rate moved, for thresholds r_K0 … r_Kn; empty without creep."""

    @classmethod
    def of(cls, s: ModelStructure, span: Vector, r: Vector, play: Vector, creep: Vector) -> Excitation:
        """The excitation from the ranges of x and y, the thresholds, and the states at the first counted sample: an
        operator moves if the input leaves z − r … z + r."""
        x_min, x_max, y_min, y_max = span.tolist()
        play_moved = (x_max - r > play) | (x_min + r < play)
        creep = creep.reshape(-1, s.lanes)
        creep_moved = np.any((x_max - r > creep) | (x_min + r < creep), axis=0)
        return cls(
            x_min,
            x_max,
            y_min,
            y_max,
            tuple(play_moved[1 : s.n + 1].tolist()),
            tuple(creep_moved[: s.creep_weights].tolist()),
        )


@dataclass(frozen=True)
class ExcitationReport:
    """How well the data determine the weights."""

    unreached: tuple[str, ...]
    """Weights whose threshold the drive never reached."""
    condition: float
    """Condition number of the unit-diagonal P over the reached weights, without the proximal term; at most 1/ε, the
    limit of rounding."""


@dataclass(frozen=True)
class Form:
    """One form of the program: z is its variable, w = ``to_weights`` z, cost = ½ zᵀP z + qᵀz + c."""

    qp: solvers.Problem
    c: float
    to_weights: Matrix

    def weights(self, z: Vector) -> Vector:
        """Weights w (d,) in normalised units of a solution z (d,)."""
        return self.to_weights @ z

    def variables(self, w: Vector) -> Vector:
        """Variables z (d,) of weights w (d,), for a warm start."""
        return np.asarray(np.linalg.solve(self.to_weights, w), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """Equation (6) for one data basis.

    Parameters
    ----------
    structure : ModelStructure
    P, q, c : array (d, d), array (d,), float
        Mean cost of the data in weight coordinates and normalised units.
    excitation : Excitation
    reference : array (d,), optional
        Weights towards which the proximal term pulls; by default those of the straight line through the range.
    proximal : float
        Strength of the proximal term relative to the mean diagonal of P in slope coordinates; 0 for none.
    min_slope : float
        Smallest admissible slope of S⁻¹ in normalised units, ε > 0.

    Examples
    --------
    >>> import numpy as np
    >>> from piezo_model.data_basis import DataBasis
    >>> structure = ModelStructure.equidistant(n=2, m=0, x_range=(-1, 1), y_range=(-2, 2), creep_rates=(),
    ...                                        sample_time=1e-3)
    >>> basis = DataBasis(structure)
    >>> x = np.sin(np.arange(1000) / 50)
    >>> basis.update(x, 2 * x)
    >>> problem = basis.problem()
    >>> problem.qp.P.diagonal().round(12).tolist()
    [1.0, 1.0, 1.0]
    """

    structure: ModelStructure
    P: Matrix
    q: Vector
    c: float
    excitation: Excitation
    reference: ArrayLike | None = None
    proximal: float = 1e-10
    min_slope: float = 1e-3

    def __post_init__(self) -> None:
        checks.not_negative(proximal=self.proximal)
        checks.positive(min_slope=self.min_slope)
        if self.reference is not None and np.shape(self.reference) != (self.structure.d,):
            raise ValueError(f"reference must have {self.structure.d} weights, not shape {np.shape(self.reference)}")

    @cached_property
    def _data_in_slopes(self) -> tuple[Matrix, Vector]:
        """P and q of the data alone in slope coordinates."""
        T = self.structure.slope_map
        P = T.T @ self.P @ T
        return 0.5 * (P + P.T), T.T @ self.q

    @cached_property
    def reached(self) -> NDArray[np.bool_]:
        """Whether the data reached the threshold of each weight, shape (d,); the others stay at their reference."""
        s, e = self.structure, self.excitation
        r_S = np.array(s.dead_zone_thresholds)
        entered = np.where(r_S > 0.0, e.y_max > r_S, (r_S == 0.0) | (e.y_min < r_S))
        diagonal = np.diag(self._data_in_slopes[0])
        return np.array([*e.play_moved, *entered, *e.creep_moved, *[True] * s.offset]) & (
            diagonal > ROUNDING * np.max(diagonal)
        )

    @cached_property
    def _in_slopes(self) -> tuple[Matrix, Vector, float]:
        """P, q and c with the proximal term and the unreached weights fixed."""
        s = self.structure
        P, q = self._data_in_slopes
        reference = s.straight_line if self.reference is None else np.asarray(self.reference, dtype=np.float64)
        v_ref = s.inverse_slope_map @ reference
        rho = self.proximal * float(np.mean(np.diag(P)))
        fixed = np.where(self.reached, 0.0, v_ref)
        c = self.c + float(q @ fixed + 0.5 * fixed @ P @ fixed)
        q = np.where(self.reached, q + P @ fixed, 0.0)
        P = np.where(np.outer(self.reached, self.reached), P, 0.0)
        return P + rho * np.eye(s.d), q - rho * v_ref, c + 0.5 * rho * float(v_ref @ v_ref)

    def form(
        self, coordinates: Coordinates = "slope", scaling: Scaling = "scaled", like: IdentificationProblem | None = None
    ) -> Form:
        """Return the program as a box in slope coordinates or with partial-sum rows in weight coordinates.

        In slope coordinates the variables may be scaled as in another problem, ``like``, whose P then has the unit
        diagonal.
        """
        if coordinates not in ("slope", "weight") or scaling not in ("scaled", "raw"):
            raise ValueError(f"unknown form {coordinates!r}, {scaling!r}")
        s = self.structure
        P, q, c = self._in_slopes
        lb = s.lower_bounds(self.min_slope)
        rows = s.inverse_slope_map[s.slices[1]]
        if coordinates == "weight":
            S = s.inverse_slope_map
            P, q = S.T @ P @ S, S.T @ q
            P = 0.5 * (P + P.T)
            lb[s.slices[1]] = -np.inf
        if scaling == "raw":
            unit, cost = np.ones(s.d), s.x_scale**2  # V/µm for slopes, V for the offset
            unit[s.slices[1]] = s.x_scale / abs(s.y_scale)
            if s.offset:
                unit[-1] = s.x_scale
        else:
            diagonal = np.diag(P if like is None else like._in_slopes[0])
            unit, cost = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 1.0
        D = 1.0 / unit  # the solver's variable is z = unit · v, so v = D z
        P, q, c, lb = cost * P * np.outer(D, D), cost * D * q, cost * c, lb * unit  # P stays exactly symmetric
        if scaling == "scaled" and like is None:
            np.fill_diagonal(P, np.where(np.diag(P) > 0.0, 1.0, 0.0))
        upper = np.full(s.d, np.inf)
        if coordinates == "slope":
            return Form(solvers.Problem(P, q, lb=lb, ub=upper), c, s.slope_map * D)
        row_unit = 1.0 / np.max(np.abs(rows * D), axis=1)  # the largest element of every row is 1
        G, h = -rows * D * row_unit[:, None], np.full(s.dead_zones, -self.min_slope) * row_unit
        return Form(solvers.Problem(P, q, G=G, h=h, lb=lb, ub=upper), c, np.diag(D))

    @property
    def qp(self) -> solvers.Problem:
        """The default form: the box in slope coordinates, scaled."""
        return self.form().qp

    def cost(self, w: ArrayLike) -> float:
        """Half the mean squared error (5) of weights w in normalised units, without the proximal term."""
        w = np.asarray(w, dtype=np.float64)
        return float(0.5 * w @ self.P @ w + self.q @ w + self.c)

    def excitation_report(self) -> ExcitationReport:
        """Report the unreached thresholds and the condition number of the program."""
        P, reached = self._data_in_slopes[0], self.reached
        names = np.array(self.structure.weight_names)
        if not reached.any():
            return ExcitationReport(tuple(names.tolist()), 1.0)
        D = 1.0 / np.sqrt(np.diag(P)[reached])
        values = np.linalg.eigvalsh(P[np.ix_(reached, reached)] * np.outer(D, D))
        return ExcitationReport(
            tuple(names[~reached].tolist()),
            float(values[-1] / max(values[0], np.finfo(float).eps * values[-1])),
        )
