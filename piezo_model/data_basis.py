"""The data basis of the identification, accumulated sample by sample.

Each sample gives one row (x, Ξ) of the error model (5) (`regressors`), and the cost is the mean square
V(w) = ½ wᵀP w + qᵀw + c with

    P = Σ λ^(N−k) Ξ Ξᵀ / W,   q = Σ λ^(N−k) Ξ x / W,   c = ½ Σ λ^(N−k) x² / W,   W = Σ λ^(N−k)

with the forgetting factor λ ≤ 1 (λ = 1: W = N, plain means). The memory needed does not grow with the recording. Rows
are added in blocks of a fixed size, so that the result does not depend on how the samples are split into chunks.

Source: the paper's equations (3) to (6); K. Kuhnen, European Journal of Control 9 (2003) 407–418.
"""

import copy

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.core import Stateful, bindings, exclusively
from piezo_model.identification_problem import Excitation, IdentificationProblem
from piezo_model.operator_state import OperatorState
from piezo_model.regressors import full_gram, new_basis
from piezo_model.structure import ModelStructure
from solvers.arrays import Matrix, Vector


class DataBasis(Stateful):
    """Streaming P, q and c of equation (6).

    Parameters
    ----------
    structure : ModelStructure
    state : OperatorState, optional
        States of the operators before the first sample, copied to ``basis.state``; by default those of a compensator's
        stage at rest.
    forgetting : float
        λ in (0, 1] per sample; 1 forgets nothing.

    Examples
    --------
    >>> import numpy as np
    >>> structure = ModelStructure.equidistant(n=2, m=1, x_range=(-1, 1), y_range=(-2, 2), creep_rates=(),
    ...                                        sample_time=1e-3)
    >>> x = np.sin(np.arange(1000) / 50)
    >>> whole, parts = DataBasis(structure), DataBasis(structure)
    >>> whole.update(x, 2 * x)
    >>> parts.update(x[:333], 2 * x[:333]); parts.update(x[333:], 2 * x[333:])
    >>> bool(np.array_equal(whole.P, parts.P))
    True
    """

    def __init__(self, structure: ModelStructure, state: OperatorState | None = None, forgetting: float = 1.0) -> None:
        checks.instance(ModelStructure, structure=structure)
        checks.require(lambda value: 0.0 < value <= 1.0, "above 0 and at most 1", forgetting=forgetting)
        self.structure, self.forgetting = structure, forgetting
        self._core = new_basis(structure, forgetting)
        state = OperatorState.before_drive(structure) if state is None else state
        OperatorState.check_fits(state, structure)
        self.state.play[:], self.state.creep[:] = state.play, state.creep
        self._start = state.copy()
        self._span = np.array([np.inf, -np.inf, np.inf, -np.inf])

    @property
    def state(self) -> OperatorState:
        """States of the operators before the next sample, as writable views."""
        return OperatorState(self._core["play"], self._core["creep"])

    @property
    def samples(self) -> int:
        """Number of counted samples."""
        return int(self._core.as_int64("counts")[1])

    @exclusively
    def update(self, x: ArrayLike, y: ArrayLike, count: bool = True) -> None:
        """Add the next samples.

        Parameters
        ----------
        x, y : array (N,)
            Input and measured output in the structure's units, for any N. If an output is missing (NaN), its sample
            only advances the operator states.
        count : bool
            False only advances the operator states, for samples that cannot be trusted; P, q and c are unchanged.

        Raises
        ------
        ValueError
            For arrays of different length or other values that are not finite; the basis is then unchanged.
        """
        s = self.structure
        x, y = checks.vectors(x=x, y=y)
        checks.finite_arrays(x=x, y=np.where(np.isnan(y), 0.0, y))
        x, y = s.unit_input(x), s.unit_output(y) if count else np.full(y.size, np.nan)
        known = ~np.isnan(y)
        if known.any() and self.samples == 0:
            first = int(np.argmax(known))
            bindings.basis_update(self._core.block, x[:first], y[:first])
            x, y, known, r, state = x[first:], y[first:], known[first:], self._core["r"], self.state
            self._start = OperatorState(
                np.maximum(x[0] - r, np.minimum(x[0] + r, state.play)),
                state.creep.copy(),
            )
        low, high = self._span[::2], self._span[1::2]
        self._span[::2] = np.minimum(low, (x[known].min(initial=np.inf), y[known].min(initial=np.inf)))
        self._span[1::2] = np.maximum(high, (x[known].max(initial=-np.inf), y[known].max(initial=-np.inf)))
        bindings.basis_update(self._core.block, x, y)

    def _mean_gram(self) -> Matrix:
        if self.samples == 0:
            raise ValueError("the data basis is empty: no sample was counted")
        total_weight = float(self.samples)
        if self.forgetting < 1.0:
            total_weight = float(-np.expm1(self.samples * np.log(self.forgetting)) / (1.0 - self.forgetting))
        finished = copy.copy(self._core)
        bindings.basis_finish(finished.block)
        return full_gram(finished["gram"], self.structure) / total_weight

    @property
    def P(self) -> Matrix:
        """Mean of Ξ Ξᵀ, shape (d, d), weight coordinates, normalised units."""
        return self._mean_gram()[1:, 1:].copy()

    @property
    def q(self) -> Vector:
        """Mean of Ξ x, shape (d,)."""
        return self._mean_gram()[0, 1:].copy()

    @property
    def c(self) -> float:
        """Half the mean of x²."""
        return float(0.5 * self._mean_gram()[0, 0])

    @property
    def excitation(self) -> Excitation:
        """Ranges of input and output over the counted samples, and the operators that moved."""
        start = self._start
        return Excitation.of(self.structure, self._span, self._core["r"], start.play, start.creep)

    def problem(self, reference: ArrayLike | None = None, **options: float) -> IdentificationProblem:
        """Quadratic program (6) of the counted samples; options as for ``IdentificationProblem``."""
        gram = self._mean_gram()
        return IdentificationProblem(
            self.structure,
            gram[1:, 1:].copy(),
            gram[0, 1:].copy(),
            float(0.5 * gram[0, 0]),
            self.excitation,
            reference,
            **options,
        )
