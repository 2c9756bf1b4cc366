"""Learning in random situations: error of each mode relative to the floor, and its worst situation.

Each situation (`situations`) is an actuator, its sensor and a reference that were not used to tune the learning. The
error of the last of five cycles is divided by the floor (`hindsight`), the smallest error of the same structure on that
cycle.
"""

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
import pandas as pd
from hindsight import floor, tracking_error
from outputs import arguments, show
from situations import CYCLE_S, Situation

from bench.report.report import Axis, Figure, Mark, Plot
from piezo_model import Compensator, HysteresisCreepModel, OperatorState, SelfLearningCompensator
from piezo_model.learning.settings import Mode

FIRST_SEED = 5000
"""First seed whose situations were not used to tune the learning."""
SAMPLE_TIME = 5e-4
CYCLES = 5
WAYS: dict[str, tuple[Mode, str]] = {
    "cyclic, projected": ("cyclic", "projected_difference"),
    "cyclic, exact": ("cyclic", "box_active_set"),
    "continuous": ("continuous", "box_active_set"),
}
"""Mode and solver."""


def learner_of(situation: Situation, way: str, n: int = 5, m: int = 3, **options: Any) -> SelfLearningCompensator:
    """A learner with the ranges assumed by the user; the actuator is at the low end of its drive."""
    mode, solver = WAYS[way]
    structure = situation.structure(n, m)
    state = OperatorState.settled_at(structure, situation.x_limits[0], came_from="above")
    return SelfLearningCompensator(
        structure,
        solver=solver,
        mode=mode,
        x_limits=situation.x_limits,
        state=state,
        solve_delay_samples=1,
        **options,
    )


def straight_error(situation: Situation) -> float:
    """Error in the last cycle of the straight line that a learner starts with."""
    structure, sensor = situation.structure(), situation.sensor()
    model = HysteresisCreepModel.from_weights(structure, structure.straight_line)
    y = sensor.run(Compensator(model, situation.x_limits).run(situation.y_ref))
    last = slice(-round(CYCLE_S / situation.sample_time), None)
    return tracking_error(y[last], situation.y_ref[last])


def rows(seed: int, ways: tuple[str, ...] = tuple(WAYS), reference: str | None = None) -> list[dict[str, Any]]:
    """One row per mode and solver: errors of each cycle, of the straight line, and the floor of the last cycle, in the
    output's unit."""
    situation = Situation.draw(seed, CYCLES * CYCLE_S, SAMPLE_TIME, reference)
    straight = straight_error(situation)
    found = []
    for way in ways:
        sensor, learner, errors = situation.sensor(), learner_of(situation, way), []
        for y_ref in np.split(situation.y_ref, CYCLES):
            state, before, structure = learner.compensator.state.copy(), deepcopy(sensor), learner.structure
            x, y = learner.run(y_ref, sensor.run)
            errors.append(tracking_error(y, y_ref))
            if not (x.min() >= situation.x_limits[0] and x.max() <= situation.x_limits[1]):
                raise AssertionError(f"seed {seed}, {way}: the drive left its limits")
        model = HysteresisCreepModel.from_weights(structure, structure.straight_line)
        least = floor(model, state, before, x, y, y_ref)
        found.append(
            {
                "seed": seed,
                "plant": situation.plant,
                "reference": situation.reference,
                "way": way,
                "ratio": errors[-1] / least,
                "floor": least,
                "straight": straight,
                "hand_overs": learner.counts["hand_overs"],
                **{f"cycle_{i}": error for i, error in enumerate(errors, 1)},
            }
        )
    return found


def figure(table: pd.DataFrame) -> Figure:
    """Share of situations within a multiple of the floor, for each mode."""
    ranked = table.sort_values("ratio").assign(name=lambda rows: rows["way"])
    ranked["kind"] = np.where(
        ranked["reference"] == "changing_amplitude", "amplitude changes each cycle", "other references"
    )
    ranked["share"] = ranked.groupby(["kind", "way"]).cumcount().add(1) / ranked.groupby(["kind", "way"])[
        "ratio"
    ].transform("size")
    share, marks = (
        Axis("share", "situations at most there", format="%"),
        (Mark("step", "name"), Mark("point", "name", size=25.0)),
    )
    plots = [
        Plot(
            Axis("ratio", f"{kind}: error of the fifth cycle over the floor", log=True),
            share,
            marks,
            ("seed", "plant", "reference", "ratio"),
            where={"kind": [kind]},
            height=260,
        )
        for kind in ranked["kind"].unique()
    ]
    return Figure(
        "robustness",
        "Situations drawn at random",
        "Share of situations whose error of the fifth cycle is within a multiple of the floor. Actuator, "
        "sensor, reference and the ranges "
        "that the user believes in are drawn from a seed; the floor is the same structure fitted in "
        "hindsight to that very cycle "
        "(n = 5, m = 3).",
        ranked,
        plots,
    )


def sentences(table: pd.DataFrame) -> Iterator[str]:
    """For each mode, the share of situations that end near the floor, and the worst one."""
    for way, found in table.groupby("way", sort=False):
        worst = found.sort_values("ratio").iloc[-1]
        yield (
            f"{str(way).capitalize()}: {(found.ratio <= 1.5).mean():.0%} of {len(found)} situations end within 1.5 "
            "times the floor, "
            f"{(found.ratio <= 2.0).mean():.0%} within twice; the worst is seed {worst.seed} ({worst.plant}, "
            f"{worst.reference}) with "
            f"{worst.ratio:.1f} times, {worst.straight / worst.cycle_5:.0f} times nearer than the straight line "
            "that it began with."
        )
    yield (
        "Where the controller can afford it, take the continuous mode: it is nearer to the floor in every kind of "
        "situation."
    )


def main() -> None:
    """Learn in a number of situations from a first seed on."""
    given = arguments(first=FIRST_SEED, situations=20)
    table = pd.DataFrame([row for seed in range(given.first, given.first + given.situations) for row in rows(seed)])
    show(figure(table), sentences(table), given.out)


if __name__ == "__main__":
    main()
