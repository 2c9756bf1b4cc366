"""Arguments of public functions: never written to, and taken in every form that means vectors."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from learning_loops import T, learner_for, structure_for

import solvers
from piezo_model import (
    Compensator,
    CompensatorBank,
    DataBasis,
    HysteresisCreepModel,
    OperatorState,
    Recording,
    identify,
    plants,
)
from piezo_model.operators import creep, dead_zone, play
from piezo_model.stage.axis import Axis
from piezo_model.stage.decoupling import estimate_decoupling
from piezo_model.stage.stage import Stage

PLANT = plants.get("relay_preisach", sample_time=T)
STRUCTURE = structure_for(PLANT)
MODEL = HysteresisCreepModel.from_weights(STRUCTURE, STRUCTURE.straight_line)
K = np.arange(3000)
DRIVE = 75.0 + 70.0 * np.sin(K / 150) * np.sin(K / 970)
OUTPUT = plants.get("relay_preisach", sample_time=T).run(DRIVE)
Vector = np.ndarray


def states() -> OperatorState:
    return OperatorState.settled_at(STRUCTURE, 30.0, "above")


def basis_of(x: Vector, y: Vector, state: OperatorState) -> DataBasis:
    basis = DataBasis(STRUCTURE, state)
    basis.update(x, y)
    return basis


def stage() -> Stage:
    return Stage(axes=tuple(Axis(actuators=(plants.get("relay_preisach", sample_time=T),)) for _ in range(2)))


def solved(P: Vector, q: Vector) -> Vector:
    batch = solvers.BoxBatch(2)
    return batch.solve(P[None], q[None], -np.ones((1, 2)), np.ones((1, 2)))[0]


TWO = np.column_stack([DRIVE, np.roll(DRIVE, 700)])
CALLS: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
    "simulate": (MODEL.simulate, (DRIVE, states())),
    "advance": (MODEL.advance, (DRIVE, states())),
    "compensate": (lambda y, state: Compensator(MODEL, state=state).run(y), (OUTPUT, states())),
    "set a compensator's states": (lambda state: setattr(Compensator(MODEL), "state", state), (states(),)),
    "change its model": (
        lambda w: Compensator(MODEL).change_model(HysteresisCreepModel.from_weights(STRUCTURE, w)),
        (2.0 * STRUCTURE.straight_line,),
    ),
    "make a data basis": (basis_of, (DRIVE, OUTPUT, states())),
    "its problem": (lambda w: basis_of(DRIVE, OUTPUT, states()).problem(w).qp, (STRUCTURE.straight_line,)),
    "identify": (lambda x, y, state: identify(x, y, STRUCTURE, state=state), (DRIVE, OUTPUT, states())),
    "make a recording": (lambda x, y: Recording.from_arrays(x, y, T), (DRIVE, OUTPUT)),
    "run a learner": (lambda y: learner_for(PLANT, "continuous").run(y, lambda x: x / 7.5 - 10.0), (OUTPUT,)),
    "replay": (lambda y, before: learner_for(PLANT, "cyclic", build_s=1.0).replay(y, before), (OUTPUT, OUTPUT + 0.1)),
    "observe": (lambda x, y: learner_for(PLANT, "continuous").observe(x, y), (DRIVE, OUTPUT)),
    "run a bank": (lambda y, before: CompensatorBank(STRUCTURE, 8).run(y, before), (np.tile(OUTPUT[:, None], 8),) * 2),
    "run another bank": (CompensatorBank(STRUCTURE, 2).run, (TWO, TWO)),
    "run a plant": (plants.get("bouc_wen", sample_time=T).run, (DRIVE,)),
    "run a stage": (lambda x: stage().run(x), (TWO,)),
    "estimate a decoupling": (estimate_decoupling, (TWO, stage().run(TWO))),
    "play": (play, (DRIVE, np.array([5.0, 9.0]), np.array([3.0, 4.0]))),
    "creep": (lambda x, r, a, z: creep(x, r, a, T, z), (DRIVE, np.zeros(2), np.array([5.0, 9.0]), np.zeros(2))),
    "dead zone": (dead_zone, (DRIVE, np.array([-1.0, 0.0, 2.0]))),
    "solve a batch": (solved, (np.eye(2), np.array([-3.0, 0.5]))),
}


def numbers(argument: Any) -> list[Vector]:
    return [argument.play, argument.creep] if isinstance(argument, OperatorState) else [argument]


@pytest.mark.parametrize("what", CALLS)
def test_no_argument_is_written_to(what: str) -> None:
    call, arguments = CALLS[what]
    before = [array.copy() for argument in arguments for array in numbers(argument)]
    call(*arguments)
    for array, kept in zip((array for argument in arguments for array in numbers(argument)), before, strict=True):
        np.testing.assert_array_equal(array, kept)


def test_what_is_handed_out_is_the_callers_own() -> None:
    recording = Recording.from_arrays(DRIVE, OUTPUT, T)
    for arrays in (recording.arrays, lambda: next(recording.chunks()), lambda: recording.head(9).arrays()):
        x, y = arrays()
        x[:], y[:] = 0.0, 0.0
    np.testing.assert_array_equal(recording.arrays(), [DRIVE, OUTPUT])
    basis = basis_of(DRIVE, OUTPUT, states())
    P, q, excitation = basis.P, basis.q, basis.excitation
    basis.P[:], basis.q[:], basis.problem().P[:] = 0.0, 0.0, 0.0
    np.testing.assert_array_equal(basis.P, P)
    np.testing.assert_array_equal(basis.q, q)
    np.testing.assert_equal(basis.excitation, excitation)


def test_a_data_basis_keeps_no_states_of_the_caller() -> None:
    state = states()
    basis = DataBasis(STRUCTURE, state)
    before = basis.excitation
    state.play[:] = 5.0
    np.testing.assert_equal(basis.excitation, before)
