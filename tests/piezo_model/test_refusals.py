"""Invalid arguments are refused in one sentence: stage, decoupling, compensator, learner, bank, data basis, plants."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from learning_loops import T, learner_for, structure_for

from piezo_model import (
    Compensator,
    CompensatorBank,
    DataBasis,
    HysteresisCreepModel,
    OperatorState,
    SelfLearningCompensator,
    plants,
)
from piezo_model.signals import random_walk
from piezo_model.stage.axis import Axis
from piezo_model.stage.decoupling import estimate_decoupling
from piezo_model.stage.stage import Stage

PLANT = plants.get("relay_preisach", sample_time=T)
STRUCTURE, OTHER = structure_for(PLANT), structure_for(PLANT, n=12)
MODEL = HysteresisCreepModel.from_weights(STRUCTURE, STRUCTURE.straight_line)
ELSEWHERE = OperatorState.settled_at(OTHER, 0.0)
WALK = random_walk(duration_s=2.0, sample_time=T, low=0.0, high=150.0, seed=0, spread_per_root_s=3.0)
NOT_FINITE = np.where(np.arange(10).reshape(5, 2) == 7, np.nan, 0.0)


def stage(**options: object) -> Stage:
    one, other = (Axis(actuators=(plants.get("relay_preisach", sample_time=T),)) for _ in range(2))
    return Stage(axes=(one, other), **options)


def mixed(x: np.ndarray) -> np.ndarray:
    """Outputs of a stage whose axes are coupled."""
    return stage(coupling=np.array([[1.0, 0.06], [-0.04, 0.97]])).run(x)


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "an axis of three": (lambda: Axis(actuators=(PLANT,) * 3), "one actuator or two in push-pull, not 3"),
    "unlike actuators": (
        lambda: Axis(actuators=(plants.get("bouc_wen"), plants.get("bouc_wen", x_range=(0.0, 100.0)))),
        "same x_range",
    ),
    "negative damping": (lambda: Axis(actuators=(PLANT,), damping_ratio=-1.0), "damping_ratio"),
    "singular coupling": (lambda: stage(coupling=[[1.0, 1.0], [1.0, 1.0]]), "regular matrix"),
    "one drive for two axes": (lambda: stage().run(np.zeros(5)), r"shape \(N, 2\), not of shape \(5,\)"),
    "a drive that is not finite": (lambda: stage().run(NOT_FINITE), r"x\[3, 1\] is not a finite number"),
    "axes driven alike": (
        lambda: estimate_decoupling(np.column_stack([WALK, WALK]), mixed(np.column_stack([WALK, WALK]))),
        "drive the two axes independently",
    ),
    "an axis at rest": (
        lambda: estimate_decoupling(np.column_stack([WALK, 0.0 * WALK]), np.column_stack([WALK, WALK])),
        "axis 1 does not move",
    ),
    "a short recording": (lambda: estimate_decoupling(np.ones((20, 2)), np.ones((20, 2))), "too few"),
    "limits of a compensator": (
        lambda: Compensator(MODEL, (1.0, math.nan)),
        r"x_limits must be two numbers in ascending order, not \(1\.0, nan\)",
    ),
    "its rate limit": (
        lambda: Compensator(MODEL, rate_limit=0.0),
        "rate_limit must be above 0 and below .*, not 0",
    ),
    "its states": (
        lambda: Compensator(MODEL, state=ELSEWHERE),
        "states are those of another structure: 16 of play and 64 of creep where 8 and 32",
    ),
    **{
        f"a start at {x_start} of {name}": (
            lambda what=what, x_start=x_start: what(x_limits=(0.0, 100.0), x_start=x_start),
            rf"x_start(\[0\])? must be within the limits of the drive, 0 to 100, not {x_start:g}",
        )
        for x_start in (-1.0, 101.0, math.nan, math.inf)
        for name, what in (
            ("a compensator", partial(Compensator, MODEL)),
            ("a learner", partial(SelfLearningCompensator, STRUCTURE)),
            ("a bank", partial(CompensatorBank, STRUCTURE, 1)),
        )
    },
    "the start of one actuator": (
        lambda: CompensatorBank(STRUCTURE, 3, x_start=[0.0, 150.0, 151.0]),
        r"x_start\[2\] must be within the limits of the drive, 0 to 150, not 151",
    ),
    "the starts of too few actuators": (
        lambda: CompensatorBank(STRUCTURE, 3, x_start=[0.0, 150.0]),
        r"x_start must be one number or one for each actuator, not of shape \(2,\)",
    ),
    "a start beside states": (
        lambda: Compensator(MODEL, state=Compensator(MODEL).state, x_start=0.0),
        "give either state or x_start: the states say where the drive starts",
    ),
    **{
        f"an integral gain of {gain}": (
            lambda gain=gain: Compensator(MODEL, integral_gain=gain),
            "integral_gain must be from 0 to 1/sample_time, 1000 per second",
        )
        for gain in (-1.0, np.nan, 1.1 / T)
    },
    "a drive of a learner": (
        lambda: learner_for(PLANT).observe([0.0, math.nan], [0.0, 0.0]),
        r"x\[1\] is not a finite number",
    ),
    "vectors of a learner": (lambda: learner_for(PLANT).replay([0.0, 1.0], [0.0]), "vectors of the same length"),
    "limits of a learner": (
        lambda: SelfLearningCompensator(STRUCTURE, x_limits=(1.0, 0.0)),
        "x_limits must be two finite numbers in ascending order",
    ),
    "a model of a learner": (
        lambda: SelfLearningCompensator(OTHER, model=MODEL),
        "the model has another structure than the one given",
    ),
    **{
        f"{name} of a learner, {value}": (
            lambda name=name, value=value: SelfLearningCompensator(STRUCTURE, **{name: value}),
            f"{name} must be {sentence}",
        )
        for name, value, sentence in (
            ("mode", "sideways", "one of cyclic, continuous, not 'sideways'"),
            ("build_s", 0.0, "a positive number of seconds up to 1e.09, not 0.0"),
            ("learn_s", math.nan, "a positive number of seconds up to 1e.09, not nan"),
            ("proximal", -1.0, "at least 0 and below 1, not -1.0"),
            ("solve_delay_samples", 0, r"a whole number from 1 to \d+, not 0"),
            ("solve_delay_samples", 2**70, r"a whole number from 1 to \d+, not"),
        )
    },
    "a solver of a learner": (
        lambda: SelfLearningCompensator(STRUCTURE, solver="nobody"),
        "there is no solver 'nobody'",
    ),
    "an empty bank": (lambda: CompensatorBank(STRUCTURE, 0), "count must be a whole number of at least 1, not 0"),
    "a bank without memory": (
        lambda: CompensatorBank(STRUCTURE, 2, forgetting_time_s=0.0),
        "forgetting_time_s must be a positive number of seconds",
    ),
    "limits of a bank": (
        lambda: CompensatorBank(STRUCTURE, 2, x_limits=(np.array([0.0, 5.0]), np.array([10.0, 5.0]))),
        r"x_limits\[1\] must be two numbers in ascending order",
    ),
    "an actuator that a bank has not": (
        lambda: CompensatorBank(STRUCTURE, 30).remove(30),
        "there are actuators 0 to 29, and not 30",
    ),
    **{
        f"forgetting by {forgetting}": (
            lambda forgetting=forgetting: DataBasis(STRUCTURE, forgetting=forgetting),
            "forgetting must be above 0 and at most 1",
        )
        for forgetting in (0.0, 1.1, np.nan)
    },
    "states of a data basis": (lambda: DataBasis(STRUCTURE, ELSEWHERE), "states are those of another structure"),
    "a data basis without data": (
        lambda: DataBasis(STRUCTURE).P,
        "the data basis is empty: no sample was counted",
    ),
    "states of a model": (
        lambda: MODEL.simulate([0.0], ELSEWHERE),
        "16 of play and 64 of creep where 8 and 32 are needed",
    ),
    "an option of a plant": (lambda: plants.get("bouc_wen", lines=3), "'bouc_wen' has no option 'lines'"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_invalid_arguments_are_refused_in_one_sentence(what: str) -> None:
    call, sentence = REFUSED[what]
    with pytest.raises(ValueError, match=sentence) as refused:
        call()
    assert "\n" not in str(refused.value)
