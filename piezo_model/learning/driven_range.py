"""Adaptation of the thresholds to the range that is driven, separately for drive and output:

    widen    if the drive at any time, or the output in a whole piece without a fault, exceeds OVER times the range
    narrow   if 6 pieces in a row stay within half of the range, or 60 within ¾

A piece is a cycle, or PIECE_S of continuous operation. The new range is the union of the old and the driven one, or the
range of those pieces, with MARGIN on both sides. The thresholds keep their normalised values and the model is
converted: with x̃ = h + g x̃' the play of threshold r is h + g times the play of threshold r/g, so the weights follow
from the virgin curve φ(r) = Σ w_i max(r − r_i, 0) at the new thresholds; likewise for creep. S⁻¹ gets the mean
slopes of the old one between the new thresholds, and the constant the shifts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from piezo_model.json_file import Number
from piezo_model.model import HysteresisCreepModel
from piezo_model.operators import dead_zone
from piezo_model.structure import ModelStructure
from solvers.arrays import Vector

Span = tuple[Number, Number, Number, Number]
"""Lowest and highest drive, lowest and highest output, in normalised units."""

OVER, MARGIN = 1.1, 0.05
UNDER = {6: 0.5, 60: 0.75}
"""Share of the range within which the driven range must stay to be narrowed, by the number of pieces: since a change
discards one cycle of learning, a small gain requires a long observation."""
LONGEST, PIECE_S = max(UNDER), 10.0


@dataclass
class DrivenRange:
    """Spans of the last pieces; a piece consists of ``per_piece`` observations."""

    per_piece: Annotated[int, Meta(ge=1, le=2**53)] = 1
    spans: list[Span] = field(default_factory=list)
    """Span of each piece; the last piece may be incomplete."""
    observed: Annotated[int, Meta(ge=0, le=2**53)] = 0
    """Number of observations since the last change of the ranges."""

    def __post_init__(self) -> None:
        if self.observed % self.per_piece and not self.spans:
            raise ValueError(f"the span of an incomplete piece of {self.observed} observations is missing")

    def observe(self, span: Sequence[float] | Vector, s: ModelStructure) -> ModelStructure | None:
        """Add the span since the last observation; returns a structure of other ranges if they should change."""
        before = self.spans.pop() if self.observed % self.per_piece else span
        ends = zip(span, before, (min, max, min, max), strict=True)
        x_low, x_high, y_low, y_high = (float(wider(now, then)) for now, then, wider in ends)
        self.spans = [*self.spans, (x_low, x_high, y_low, y_high)][-LONGEST:]
        self.observed += 1
        spans, whole = np.array(self.spans), self.observed % self.per_piece == 0
        ranges: dict[str, Any] = {}
        for name, low, high in (("x", 0, 1), ("y", 2, 3)):
            bottom, top = float(spans[:, low].min()), float(spans[:, high].max())
            if beyond := max(-bottom, top) > OVER and (whole or name == "x"):
                bottom, top = min(bottom, -1.0), max(top, 1.0)
            half = 0.5 * (top - bottom)
            if beyond or any(
                self.observed >= pieces * self.per_piece and 0.0 < half < share for pieces, share in UNDER.items()
            ):
                centre, scale = getattr(s, f"{name}_centre"), getattr(s, f"{name}_scale")
                ranges |= {
                    f"{name}_centre": centre + scale * 0.5 * (bottom + top),
                    f"{name}_scale": scale * half * (1.0 + 2.0 * MARGIN),
                }
        if not ranges:
            return None
        self.spans.clear()
        self.observed = 0
        return replace(s, **ranges)

    def interrupt(self) -> None:
        """Discard an incomplete piece after a sensor fault."""
        if self.observed % self.per_piece:
            self.spans.pop()
            self.observed -= self.observed % self.per_piece


def carried_over(model: HysteresisCreepModel, new: ModelStructure) -> HysteresisCreepModel:
    """Convert a model to a structure that differs in its ranges and has a constant.

    Examples
    --------
    >>> from dataclasses import replace
    >>> structure = ModelStructure.equidistant(n=3, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
    ...                                        sample_time=1e-3, offset=True)
    >>> model = HysteresisCreepModel.from_weights(structure, [0.0, 0.4, 0.0, 1.0, 0.1])
    >>> # the play of threshold ½ is now at ¼
    >>> carried_over(model, replace(structure, x_scale=2.0)).w_H.round(12).tolist()
    [1.0, 0.4, 0.0, 0.0]
    """
    old = model.structure
    g, h = new.x_scale / old.x_scale, (new.x_centre - old.x_centre) / old.x_scale
    r = old.thresholds
    ends = g * np.append(r, 2.0 * r[-1] - r[-2] if r.size > 1 else 1.0)

    def at_new_thresholds(w: Vector) -> Vector:
        virgin = np.maximum(ends[:, None] - r, 0.0) @ w
        return np.maximum(np.diff(np.diff(virgin) / np.diff(ends), prepend=0.0), 0.0)  # φ is convex but for rounding

    def inverse_superposition(y: Vector) -> Vector:
        return dead_zone(y, old.dead_zone_thresholds) @ model.w_S_inverse

    thresholds = np.array(new.dead_zone_thresholds)
    edges = np.array([min(-1.0, 2.0 * thresholds[0]), *thresholds[thresholds != 0.0], max(1.0, 2.0 * thresholds[-1])])
    centre = (new.y_centre - old.y_centre) / old.y_scale
    u = inverse_superposition(centre + new.y_scale / old.y_scale * edges)
    block = new.slices[1]
    w_S = new.slope_map[block, block] @ (np.diff(u) / np.diff(edges)) / g
    w_K = at_new_thresholds(model.w_K) if model.w_K.size else model.w_K
    shift = h * (model.w_H.sum() + len(old.creep_rates) * model.w_K.sum()) - float(
        inverse_superposition(np.array([centre]))[0]
    )
    return HysteresisCreepModel(new, at_new_thresholds(model.w_H), w_S, w_K, (model.offset + shift) / g)
