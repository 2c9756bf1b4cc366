"""Prandtl-Ishlinskii actuator with many thresholds, creep over decades and a smooth saturation.

    Γ[u] = S( Σ_i w_Hi H_ri[u] + Σ_i w_Ki (1/J) Σ_j K_{ri,aj}[u] ),   i = 0 … n
    S(v) = ( v − c v³ + e (v² − 1) ) / (1 − c)

It has the structure of the paper's equation (2), with far more thresholds than the model and a cubic in place of the
model's polygon: a larger model approximates it better but never equals it. H is the play operator and K the creep
operator of rates a_j (K. Kuhnen, "Modeling, identification and compensation of complex hysteretic nonlinearities: a
modified Prandtl-Ishlinskii approach", European Journal of Control 9 (2003), 407-418).
"""

from dataclasses import dataclass

import numpy as np

from piezo_model import checks
from piezo_model.core import bindings
from piezo_model.plants.actuator import Actuator, Memory, along, curved
from solvers.arrays import Vector


@dataclass(kw_only=True, eq=False)
class DensePrandtlIshlinskii(Actuator):
    """The actuator of the module, in V and µm.

    Parameters
    ----------
    thresholds : int
        n + 1, the number of thresholds r_i = i / (n + 1); the first play, of threshold 0, has no memory.
    reversible_share : float
        Share of the plays' sum that belongs to threshold 0, above 0 to below 1.
    threshold_scale : float
        ρ; the other plays have the weights e^(−r/ρ).
    saturation : float
        c of the cubic.
    asymmetry : float
        e of the cubic, with 1 − 2 |e| − 3 c > 0 so that S is strictly increasing on [−1, 1] (c ≥ 0).

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("dense_prandtl_ishlinskii", creep_share=0.0)
    >>> plant.run([0.0, 150.0]).round(6).tolist()
    [-20.0, 20.0]
    """

    thresholds: int = 40
    reversible_share: float = 0.62
    threshold_scale: float = 0.4
    saturation: float = 0.08
    asymmetry: float = -0.06

    def _build(self) -> None:
        checks.whole(2, thresholds=self.thresholds)
        checks.between(0.0, 1.0, reversible_share=self.reversible_share)
        checks.positive(threshold_scale=self.threshold_scale)
        curved(np.zeros(1), self.saturation, self.asymmetry)
        r = np.arange(self.thresholds) / self.thresholds
        weight = np.exp(-r / self.threshold_scale)
        # Each operator of threshold r settles at ±(1 − r) at the ends; both sums are normalised there.
        self._w_K = self.creep_share * weight / (weight @ (1.0 - r))
        weight[0] = 0.0
        self._w_H = (1.0 - self.reversible_share) * weight / (weight @ (1.0 - r))
        self._w_H[0] = self.reversible_share
        self._w_H *= 1.0 - self.creep_share
        self._r = r

    def _rest(self) -> Memory:
        settled = -(1.0 - self._r)
        z_creep = np.repeat(settled[:, None], self._a.size, axis=1)
        return {"z_play": settled, "z_creep": z_creep, "u_previous": np.full(1, -1.0)}

    def _respond(self, u: Vector) -> Vector:
        parameters = self._r, self._w_H, self._w_K, self._a
        v = along(bindings.plays_and_creep, u, *parameters, *self._memory.values())
        return curved(v, self.saturation, self.asymmetry)
