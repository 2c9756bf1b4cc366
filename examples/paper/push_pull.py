"""Does the model need the superposition operator S? One actuator per axis and two in push-pull, m = 0 and m = 3.

The paper drives every axis by one actuator to show the use of S; two in push-pull make the loop point-symmetric, as is
the operator H. A symmetric loop need not be one of H, though: the even part of a curvature cancels, but an odd
saturation does not. The comparison therefore uses actuators of three kinds, and n = 10 plays besides the
paper's n = 5, since with few plays the dead zones also replace missing plays.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from outputs import arguments, show
from two_axis_stage import Actuators, Setup, learned, setup_of

from bench.report.report import PALETTE, Axis, Figure, Mark, Plot

KINDS: dict[str, Actuators] = {
    "curved": ("dense_prandtl_ishlinskii", {"saturation": 0.0, "asymmetry": -0.1}),
    "curved and saturating": ("dense_prandtl_ishlinskii", {}),
    "Preisach": ("relay_preisach", {}),
}
"""Deformations of the loops: an even curvature; this with an odd saturation; minor loops that depend on the bias."""
ORDERS = (5, 10)
WITHOUT_S, WITH_S = 0, 3
MODELS = {WITHOUT_S: "without S (m = 0)", WITH_S: f"with S (m = {WITH_S})"}
AS_GOOD = 1.1
"""Ratio of errors up to which the model without S counts as equally good."""


@dataclass(frozen=True)
class Case:
    """One setup: kind of actuators, number of plays, push-pull or not, number of dead zones on either side."""

    kind: str
    n: int
    push_pull: bool
    m: int

    def __str__(self) -> str:
        return f"{self.kind} actuators, {'push-pull' if self.push_pull else 'single'}, n = {self.n}, m = {self.m}"

    def row(self, setup: Setup) -> dict[str, Any]:
        """Run the case with an exact learner, so that only the model matters."""
        actuators = KINDS[self.kind]
        trial = learned(
            replace(
                setup,
                actuators=(actuators, actuators),
                n=self.n,
                m=self.m,
                push_pull=self.push_pull,
                solver="box_active_set",
            )
        )
        return {**asdict(self), "rms_percent": float(np.sqrt(np.mean(trial.rms[-1] ** 2)))}


CASES = tuple(
    Case(kind, n, pair, m) for kind in KINDS for n in ORDERS for pair in (False, True) for m in (WITHOUT_S, WITH_S)
)


def figure(table: pd.DataFrame) -> Figure:
    """Draw the rows of all cases."""
    drawn = table.assign(
        name=table.m.map(MODELS),
        stage=[
            f"{kind}, n = {n}, {'push-pull' if pair else 'one actuator'}"
            for kind, n, pair in zip(table.kind, table.n, table.push_pull, strict=True)
        ],
    )
    plot = Plot(
        Axis("rms_percent", "RMS error in the last cycle, % of range", log=True),
        Axis("stage"),
        (Mark("point", "name", size=90.0),),
        ("stage", "name", "rms_percent"),
        dict(zip(MODELS.values(), (PALETTE[1], PALETTE[0]), strict=True)),
        height=320,
    )
    return Figure(
        "push_pull",
        "One actuator or two in push-pull, with and without S",
        "RMS error of both axes in the last cycle. The learner is exact, so that only the model makes the difference.",
        drawn,
        [plot],
    )


def sentences(table: pd.DataFrame) -> Iterator[str]:
    """Compare the models with and without S for each kind of actuator."""
    error = dict(zip(CASES, table.rms_percent, strict=True))
    n = max(ORDERS)
    for kind in KINDS:
        single, single_S, pair, pair_S = (
            error[Case(kind, n, together, m)] for together in (False, True) for m in (WITHOUT_S, WITH_S)
        )
        ratio = pair / pair_S
        judged = "as good as with it" if ratio <= AS_GOOD else f"{ratio:.1f} times as bad"
        yield (
            f"{kind.capitalize()} actuators, n = {n}: with one actuator the error without S is "
            f"{single / single_S:.1f} times "
            f"that with it ({single:.3f} % and {single_S:.3f} %); in push-pull the model without S is {judged} "
            f"({pair:.4f} % and {pair_S:.4f} %)."
        )


def main() -> None:
    """Let a stage learn in every case."""
    given = arguments(quick=False, seed=0)
    table = pd.DataFrame([case.row(setup_of(given)) for case in CASES])
    show(figure(table), sentences(table), given.out)


if __name__ == "__main__":
    main()
