"""Relay Preisach plane with a smooth density that is not separable, plus a reversible part and creep.

    Γ[u] = λ u + (1 − λ) ∫∫ μ(r, s) R_{s−r, s+r}[u] ds dr

R_{β,α} is the relay that switches up to +1 when u passes α = s + r and down to −1 when it passes β = s − r
(F. Preisach, "Über die magnetische Nachwirkung", Zeitschrift für Physik 94 (1935), 277-302; I. Mayergoyz,
"Mathematical Models of Hysteresis and Their Applications", Elsevier 2003, ch. 1). Relays that share the half width r
are all up below s = z_r and all down above it, where z_r is the play operator of threshold r (M. Brokate and
J. Sprekels, "Hysteresis and Phase Transitions", Springer 1996, ch. 2). So a whole line of relays is one play state
and the line's distribution function:

    ∫ μ(r, s) R_{s−r, s+r}[u] ds = q_r(z_r),   q_r' = 2 μ(r, ·)

The half widths r are discrete, the centres s continuous, so that y has no jumps: with 60 discrete switching levels each
jump would be 0.4 % of the range, more than the error of a good compensation. With q_r linear this would be a
Prandtl-Ishlinskii operator; here

    q_r(s) ∝ t / sqrt(1 + t²),   t = (s − c(r)) / σ(r),   c(r) = c_0 − c_1 r,   σ(r) = σ_0 − σ_1 r

so the density is a hill whose centre and breadth depend on r, and the width of a minor loop depends on its bias.
"""

from dataclasses import dataclass

import numpy as np

from piezo_model import checks
from piezo_model.core import bindings
from piezo_model.plants.actuator import Actuator, Memory, along
from solvers.arrays import Vector


@dataclass(kw_only=True, eq=False)
class RelayPreisach(Actuator):
    """The relay Preisach plane of the module, in V and µm.

    Parameters
    ----------
    lines : int
        Number of half widths r, equidistant between 0 and 1.
    reversible_share : float
        λ, the part of the displacement without memory, 0 to below 1.
    half_width_scale : float
        ρ; the line of relays of half width r has the weight e^(−r/ρ).
    hill_centre, hill_centre_slope : float
        c_0 and c_1.
    hill_breadth, hill_breadth_slope : float
        σ_0 and σ_1, with σ_0 > 0 and σ_0 > σ_1.

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("relay_preisach", creep_share=0.0)
    >>> up, top, down = plant.run([75.0, 150.0, 75.0])
    >>> bool(up < down < top)
    True
    """

    lines: int = 60
    reversible_share: float = 0.73
    half_width_scale: float = 0.45
    hill_centre: float = 0.15
    hill_centre_slope: float = 0.5
    hill_breadth: float = 1.1
    hill_breadth_slope: float = 0.6

    def _build(self) -> None:
        checks.whole(1, lines=self.lines)
        checks.share(reversible_share=self.reversible_share)
        checks.positive(half_width_scale=self.half_width_scale, hill_breadth=self.hill_breadth)
        checks.require(
            lambda slope: slope < self.hill_breadth, "below hill_breadth", hill_breadth_slope=self.hill_breadth_slope
        )
        r = (np.arange(self.lines) + 0.5) / self.lines
        c = self.hill_centre - self.hill_centre_slope * r
        sigma = self.hill_breadth - self.hill_breadth_slope * r
        # A play of threshold r moves between −(1 − r) and 1 − r; its line of relays goes from all down to all up.
        t_down, t_up = (-(1.0 - r) - c) / sigma, (1.0 - r - c) / sigma
        q_down, q_up = t_down / np.sqrt(1.0 + t_down**2), t_up / np.sqrt(1.0 + t_up**2)
        weight = np.exp(-r / self.half_width_scale)
        gain = 2.0 * weight / weight.sum() / (q_up - q_down)
        self._r, self._c, self._sigma, self._gain = r, c, sigma, gain
        self._shift = float(gain @ (q_up + q_down)) / 2.0

    def _rest(self) -> Memory:
        return {"z_play": -(1.0 - self._r), **self._rest_of_log_creep()}

    def _respond(self, u: Vector) -> Vector:
        parameters = self._r, self._c, self._sigma, self._gain, self._shift
        relays = along(bindings.relay_lines, u, *parameters, self._memory["z_play"])
        return self._with_log_creep(self.reversible_share * u + (1.0 - self.reversible_share) * relays, u)
