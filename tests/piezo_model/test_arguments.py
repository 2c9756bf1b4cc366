"""Arguments of public functions: never written to, taken in every form that means vectors, and refused in one sentence
that names them."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from known_models import a_drive, basis_of, structure
from learning_loops import MODEL, PLANT, STRUCTURE, T, learner_for, structure_for

from piezo_model import (
    Compensator,
    CompensatorBank,
    DataBasis,
    Dynamics,
    HysteresisCreepModel,
    OperatorState,
    Recording,
    SelfLearningCompensator,
    identify,
    plants,
)
from piezo_model.operators import creep, dead_zone, play
from piezo_model.recordings.array_table import Arrays, table_of
from piezo_model.recordings.recording import Reference
from piezo_model.signals import SIGNALS
from piezo_model.solving import solved

K = np.arange(3000)
DRIVE = 75.0 + 70.0 * np.sin(K / 150) * np.sin(K / 970)
OUTPUT = plants.get("relay_preisach", sample_time=T).run(DRIVE)
Vector = np.ndarray


def states() -> OperatorState:
    return OperatorState.settled_at(STRUCTURE, 30.0, "above")


CALLS: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
    "simulate": (MODEL.simulate, (DRIVE, states())),
    "advance": (MODEL.advance, (DRIVE, states())),
    "compensate": (lambda y, state: Compensator(MODEL, state=state).run(y), (OUTPUT, states())),
    "set a compensator's states": (lambda state: setattr(Compensator(MODEL), "state", state), (states(),)),
    "change its model": (
        lambda w: Compensator(MODEL).change_model(HysteresisCreepModel.from_weights(STRUCTURE, w)),
        (2.0 * STRUCTURE.straight_line,),
    ),
    "make a data basis": (partial(basis_of, STRUCTURE), (DRIVE, OUTPUT, states())),
    "its problem": (lambda w: basis_of(STRUCTURE, DRIVE, OUTPUT, states()).problem(w).qp, (STRUCTURE.straight_line,)),
    "identify": (lambda x, y, state: identify(x, y, STRUCTURE, state=state), (DRIVE, OUTPUT, states())),
    "make a recording": (lambda x, y: Recording.from_arrays(x, y, T), (DRIVE, OUTPUT)),
    "run a learner": (lambda y: learner_for(PLANT, "continuous").run(y, lambda x: x / 7.5 - 10.0), (OUTPUT,)),
    "replay": (lambda y, before: learner_for(PLANT, "cyclic", build_s=1.0).replay(y, before), (OUTPUT, OUTPUT + 0.1)),
    "observe": (lambda x, y: learner_for(PLANT, "continuous").observe(x, y), (DRIVE, OUTPUT)),
    "run a bank": (lambda y, before: CompensatorBank(STRUCTURE, 8).run(y, before), (np.tile(OUTPUT[:, None], 8),) * 2),
    "run another bank": (CompensatorBank(STRUCTURE, 2).run, (np.column_stack([DRIVE, np.roll(DRIVE, 700)]),) * 2),
    "run a plant": (plants.get("bouc_wen", sample_time=T).run, (DRIVE,)),
    "play": (play, (DRIVE, np.array([5.0, 9.0]), np.array([3.0, 4.0]))),
    "creep": (lambda x, r, a, z: creep(x, r, a, T, z), (DRIVE, np.zeros(2), np.array([5.0, 9.0]), np.zeros(2))),
    "dead zone": (dead_zone, (DRIVE, np.array([-1.0, 0.0, 2.0]))),
}


def numbers(argument: Any) -> list[Vector]:
    return [argument.play, argument.creep] if isinstance(argument, OperatorState) else [argument]


@pytest.mark.parametrize("what", CALLS)
def test_no_argument_is_written_to(what: str) -> None:
    call, arguments = CALLS[what]
    before = [array.copy() for argument in arguments for array in numbers(argument)]
    call(*arguments)
    np.testing.assert_equal([array for argument in arguments for array in numbers(argument)], before)


def test_what_is_handed_out_is_read_only_or_the_callers_own() -> None:
    recording = Recording.from_arrays(DRIVE, OUTPUT, T)
    recording.counted_y[:] = 0.0
    for part in (recording, recording.head(9), recording.in_units("mV", "um")):
        for array in (part.x, part.y, part.uncounted):
            with pytest.raises(ValueError, match="read-only"):
                array[:] = 0
    np.testing.assert_array_equal([recording.x, recording.counted_y], [DRIVE, OUTPUT])
    basis = basis_of(STRUCTURE, DRIVE, OUTPUT, states())
    before = shown(basis)
    basis.P[:], basis.q[:], basis.problem().P[:] = 0.0, 0.0, 0.0
    np.testing.assert_equal(shown(basis), before)


def test_a_recording_keeps_no_arrays_and_a_data_basis_no_states_of_the_caller() -> None:
    state, x = states(), DRIVE.copy()
    basis, recording = basis_of(STRUCTURE, DRIVE, OUTPUT, state), Recording.from_arrays(x, x, T)
    before = shown(basis)
    state.play[:], x[:] = 5.0, -1.0
    np.testing.assert_equal(shown(basis), before)
    np.testing.assert_array_equal([recording.x, recording.y], [DRIVE, DRIVE])


# What is not a vector of numbers is refused by the name of the argument; the object is as it was.

N = 200
WRONG: dict[str, Any] = {
    "a table": np.ones((N, 2)),
    "a column as a table": pd.DataFrame({"volts": DRIVE[:N]}),
    "a list of lists": [[1.0]] * N,
    "lists of different lengths": [[1.0], [1.0, 2.0]],
    "complex numbers": DRIVE[:N] + 1j,
    "text": ["75.0"] * N,
    "a word": "volts",
    "dates": np.full(N, "2026-01-01", dtype="datetime64[s]"),
    "nothing": None,
    "objects": [None] * N,
    "a dictionary": {"x": DRIVE[:N]},
    "a number": 75.0,
    "an array of no axis": np.array(75.0),
    "a reference": Reference(name="here", sample_time=T, values=DRIVE[:N], unit="V"),
}
TAKE_VECTORS: dict[str, tuple[Callable[[], Any], Callable[[Any, Any], Any], str]] = {
    "simulate": (lambda: MODEL, lambda model, x: model.simulate(x), "x"),
    "advance": (lambda: MODEL, lambda model, x: model.advance(x, states())[0], "x"),
    "a compensator": (lambda: Compensator(MODEL), lambda one, y: one.run(y), "y_ref"),
    "a data basis": (lambda: basis_of(STRUCTURE, DRIVE, OUTPUT, states()), lambda basis, x: basis.update(x, x), "x"),
    "a learner observes": (lambda: learner_for(PLANT, "continuous"), lambda one, x: one.observe(x, x), "x"),
    "a learner replays": (lambda: learner_for(PLANT), lambda one, y: one.replay(y, y), "y_ref"),
    "a learner runs": (lambda: learner_for(PLANT), lambda one, y: one.run(y, lambda x: x)[1], "y_ref"),
    "a plant": (lambda: plants.get("bouc_wen", sample_time=T), lambda plant, x: plant.run(x), "x"),
    "identification": (lambda: None, lambda _, x: identify(x, OUTPUT[:N], STRUCTURE, force=True).weights, "input"),
    "a recording": (lambda: None, lambda _, x: Recording.from_arrays(x, OUTPUT[:N], T).x, "input"),
    "play": (lambda: None, lambda _, x: play(x, [1.0], [0.0])[0], "x"),
}


def shown(thing: Any) -> Any:
    """All that can be seen of an object's state."""
    if isinstance(thing, DataBasis):
        return thing.P, thing.q, thing.samples, thing.state.play, thing.state.creep, thing.excitation
    return thing.get_state() if hasattr(thing, "get_state") else None


@pytest.mark.parametrize("form", WRONG)
@pytest.mark.parametrize("what", TAKE_VECTORS)
def test_what_is_no_vector_of_numbers_is_refused_by_the_name_of_the_argument(what: str, form: str) -> None:
    make, call, name = TAKE_VECTORS[what]
    thing = make()
    before = shown(thing)
    with pytest.raises(ValueError, match=rf"\b{name}\b.* must (be|hold) ") as refused:
        call(thing, WRONG[form])
    assert "\n" not in str(refused.value)
    np.testing.assert_equal(shown(thing), before)


RIGHT: dict[str, Callable[[Vector], Any]] = {
    "a list": np.ndarray.tolist,
    "a tuple": lambda x: tuple(x.tolist()),
    "a Series with an index of its own": lambda x: pd.Series(x, index=np.arange(x.size) + 5),
    "integers": lambda x: x.astype(np.int32),
    "every second of an array": lambda x: np.repeat(x, 2)[::2],
    "big-endian": lambda x: x.astype(">f8"),
    "little-endian in so many words": lambda x: x.astype(x.dtype.newbyteorder("<")),
    "masked nowhere": np.ma.masked_array,
    "read-only": lambda x: np.broadcast_to(x, x.shape),
}


@pytest.mark.parametrize("form", RIGHT)
@pytest.mark.parametrize("what", TAKE_VECTORS)
def test_vectors_may_come_in_every_form_that_means_numbers(what: str, form: str) -> None:
    make, call, _ = TAKE_VECTORS[what]
    x = np.round(DRIVE[:N])
    one, other = make(), make()
    np.testing.assert_equal((call(one, RIGHT[form](x)), shown(one)), (call(other, x), shown(other)))


BANK = CompensatorBank(STRUCTURE, 8)


OTHER = structure_for(PLANT, n=12)
ELSEWHERE = OperatorState.settled_at(OTHER, 0.0)

X, RECORDED = a_drive(400), {"sample_time": 1e-3, "x": [1, 2, 3], "y": [1, 2, 3]}
SLOW = Dynamics((11.0,), (0.02,), (0.9,), 3e-3, 4e-3)
OUT_OF_REACH: tuple[tuple[dict[str, Any], str], ...] = (
    ({"dynamics": SLOW, "T": 8e-6}, "the resonance at 11 Hz is below 0.01 % of the sampling rate, 125000 Hz"),
    (
        {"dynamics": replace(SLOW, delay_s=1.0), "T": 5e-5},
        "a delay of 1 s is longer than 10000 sampling periods of 50 µs",
    ),
    (
        {"dynamics": replace(SLOW, amplifier_lag_s=1.0), "T": 5e-5},
        "an amplifier lag of 1 s is longer than 10000 sampling periods of 50 µs",
    ),
)
"""Dynamics that do not suit a sampling period."""
OPTIONS_OF_SIGNALS: dict[str, dict[str, float]] = {
    "staircase": {"levels": 1, "hold_s": 0.0},
    "decaying_triangle": {"cycles": 0.5, "final_share": 1.5},
    "multi_sine": {"tones": 0, "highest_Hz": 500.0, "lowest_Hz": 80.0},
    "random_walk": {"bandwidth_Hz": -1.0, "spread_per_root_s": 0.0},
}
PROBLEM = basis_of(STRUCTURE, DRIVE, OUTPUT, states()).problem()
OF: dict[str, tuple[Callable[..., object], tuple[tuple[dict[str, Any], str], ...]]] = {
    "a structure": (
        structure,
        (
            ({"n": -1}, "n must be a whole number from 0 to 1000, not -1"),
            ({"x_range": (1.0, 1.0)}, r"x_range must be two finite numbers in ascending order, not \(1.0, 1.0\)"),
            ({"y_range": (0.0, np.nan)}, "y_range must be two finite numbers"),
            ({"y_range": (2.0, 2.0)}, r"y_range must be two finite numbers that differ, not \(2.0, 2.0\)"),
            ({"x_range": (1.0, -1.0)}, r"x_range must be two finite numbers in ascending order, not \(1.0, -1.0\)"),
            ({"creep_rates": (1.0, -1.0)}, r"creep_rates must be from 1e-100 to 1e\+100, not \(1.0, -1.0\)"),
            ({"creep_rates": (1.0, 1.0)}, "creep_rates must differ from each other"),
            ({"creep_rates": (np.inf,)}, "creep_rates must be from"),
            ({"sample_time": 0.0}, "sample_time must be from 1e-09 to 1e.09, not 0.0"),
            ({"sample_time": np.nan}, "sample_time must be from 1e-09 to 1e.09, not nan"),
        ),
    ),
    "another structure": (
        partial(replace, STRUCTURE),
        (
            *(({"play_thresholds": r}, "play_thresholds must be positive and ascending") for r in ((0.5, 0.5), (0.0,))),
            *(
                ({"dead_zone_thresholds": r}, "dead_zone_thresholds must be ascending with 0 among them")
                for r in ((0.1, 0.2), (), (0.0, 0.5, 0.2))
            ),
        ),
    ),
    "dynamics": (
        partial(replace, Dynamics((120.0, 900.0), (0.03, 0.01), (0.8, 0.15), 5e-5)),
        (
            ({"frequencies_Hz": (900.0, 5.0)}, r"at most 2 positive numbers in ascending order, not \(900.0, 5.0\)"),
            ({"frequencies_Hz": (1.0, 2.0, 3.0)}, "at most 2 positive"),
            ({"damping": (0.01,)}, "damping must be as many numbers as there are frequencies"),
            ({"damping": (0.01, 1.0)}, "above 0 and below 1"),
            ({"gains": (0.8, 0.3)}, "above 0 and at most 1 in all"),
            ({"delay_s": -1e-6}, r"delay_s must be from 0 to 1e\+100 s"),
            ({"amplifier_lag_s": np.nan}, r"amplifier_lag_s must be from 0 to 1e\+100 s, not nan"),
        ),
    ),
    "a problem": (
        partial(replace, PROBLEM),
        (
            ({"proximal": -1.0}, "proximal must be a finite number of at least 0, not -1.0"),
            ({"min_slope": 0.0}, "min_slope must be a positive number, not 0.0"),
            ({"reference": np.zeros(3)}, r"reference must have \d+ weights, not shape \(3,\)"),
        ),
    ),
    "its form": (PROBLEM.form, (({"coordinates": "slope", "scaling": "metric"}, "unknown form 'slope', 'metric'"),)),
    "a model at another rate": (
        MODEL.at,
        tuple(
            ({"sample_time": wrong}, r"sample_time must be from 1e-09 to 1e\+09, not")
            for wrong in (0.0, -1.0, np.nan, np.inf)
        ),
    ),
    "a model of dynamics at another rate": (
        lambda dynamics, T: replace(MODEL, dynamics=dynamics).at(T),
        OUT_OF_REACH,
    ),
    "a bank of dynamics": (
        lambda dynamics, T: CompensatorBank(replace(STRUCTURE, sample_time=T), 2, dynamics=dynamics),
        OUT_OF_REACH,
    ),
    "a learner by steps": (
        partial(learner_for, PLANT, solver="projected_difference"),
        (({"solver_options": {"step_ratio": 3.0}}, "step_ratio must lie between 0 and 1"),),
    ),
    "an answer by steps": (
        partial(solved, "projected_difference", program=PROBLEM.qp, start=np.zeros(STRUCTURE.d)),
        (({"options": {"steps": -1}}, "steps must be a whole number from 0 to"),),
    ),
    "a table of columns": (
        lambda period: table_of(Path("stage.rec"), Arrays("a format", {"u": DRIVE, "y": OUTPUT}, periods=period)),
        tuple(({"period": wrong}, "the sampling period must be from") for wrong in (0.0, -1e-3, np.nan)),
    ),
    "parts for a model with dynamics": (
        replace(MODEL, dynamics=SLOW).advance,
        (({"x": [1.0], "state": states()}, "and this one has a resonance at 11 Hz with damping 2 %"),),
    ),
    **{
        f"the plant {name}": (
            partial(plants.get, name),
            (
                *(({"x_range": (1.0, 1.0)}, "x_range"), ({"y_range": (0.0, np.nan)}, "y_range")),
                *(({"sample_time": 0.0}, "sample_time"), ({"creep_share": 1.0}, "creep_share")),
                *(({"creep_rates_per_s": rates}, "creep_rates_per_s") for rates in ((), (1.0, -1.0))),
                *(({option: value}, option) for option, value in options.items()),
            ),
        )
        for name, options in (
            (
                "relay_preisach",
                {"lines": 0, "reversible_share": 1.0, "hill_breadth": 0.0, "hill_breadth_slope": 2.0},
            ),
            ("bouc_wen", {"loading_slope": 0.0, "beta": 0.0, "gamma": 9.0, "exponent": 0.5, "stiffness": 0.1}),
            (
                "dense_prandtl_ishlinskii",
                {"thresholds": 1, "saturation": 0.5, "asymmetry": -0.5, "threshold_scale": np.inf},
            ),
            ("maxwell_slip", {"sliders": 0, "slip_share": 1.0, "reach": 2.5, "saturation": 0.5}),
            ("duhem", {"alpha": 0.0, "slope_after_turn": 0.5, "asymmetry": 0.6}),
        )
    },
    "no plant": (partial(plants.get, "stack"), (({}, "known are bouc_wen"),)),
    "a sensor": (
        partial(plants.Sensor, PLANT),
        (
            *(({"noise_um": -1.0}, "noise_um"), ({"quantum_um": np.nan}, "quantum_um"), ({"seed": -1}, "seed")),
            *(({"delay_samples": value}, "delay_samples") for value in (-1, 1.5)),
            *(({"gain_drift_per_s": np.inf}, "gain_drift_per_s"), ({"offset_um": np.nan}, "offset_um")),
        ),
    ),
    **{
        f"the signal {name}": (
            partial(
                signal,
                **{"duration_s": 2.0, "sample_time": T, "low": -20.0, "high": 130.0},
                **({"seed": 7} if name == "random_walk" else {}),
            ),
            (
                *(({"duration_s": value}, "duration_s") for value in (0.0, np.nan, 1e-4)),
                *(({"sample_time": value}, "sample_time") for value in (-1.0, np.inf)),
                *(({"low": 130.0}, "low"), ({"high": np.nan}, "high")),
                *(({option: value}, option) for option, value in OPTIONS_OF_SIGNALS.get(name, {}).items()),
            ),
        )
        for name, signal in SIGNALS.items()
    },
    "identification": (
        partial(identify, X, X, structure()),
        (
            ({"skip": 395}, "only 5 of 400 samples are counted after skipping 395, too few for 11 weights"),
            ({"skip": -1}, "skip must be a whole number of at least 0, not -1"),
            ({"lag": "later"}, "lag must be one of estimate, remove, ignore, not 'later'"),
            ({"solver": "simplex"}, "there is no solver 'simplex'"),
        ),
    ),
    "identification of other data": (
        partial(identify, structure=structure()),
        (
            ({"x": X[:9], "y": X[:9]}, "9 samples are counted, too few for 11 weights"),
            ({"x": X, "y": X**2, "skip": 388}, "the model class does not describe these data"),
            (
                {"x": K[:400] < 5, "y": X, "skip": 20},
                "the drive does not move after the first 20 samples, which are skipped",
            ),
            (
                {"x": X, "y": K[:400] < 5, "skip": 20},
                "the output does not move after the first 20 samples, which are skip",
            ),
            ({"x": X, "y": X[:-1]}, r"vectors of the same length, not of shapes \(400,\) and \(399,\)"),
            ({"x": X}, "identification from arrays needs x, y and a structure"),
            ({"x": Recording.from_arrays(X, X, 5e-3), "y": X}, "a recording contains its output"),
            ({"x": Recording.from_arrays(X, X, T)}, "sampling period is 0.001 s, but that of the structure is 0.005 s"),
        ),
    ),
    "identification of a length that drives a voltage": (
        partial(identify, n=2, m=1),
        (
            (
                {
                    "x": Recording.of(
                        {"time_s": K[:400] * 5e-3, "stroke_um": X, "reply_V": 1e4 * X % 7}, input="stroke_um"
                    )
                },
                "a length and the output a voltage, as if they were swapped$",
            ),
        ),
    ),
    "identification of creep and dynamics": (
        partial(identify, Recording.from_arrays(X, X, 5e-3), n=2, m=1),
        (
            ({"creep_rates": (1.0, 1e9)}, r"^arrays: a creep rate of 1e[+]09 per second is above the sampling"),
            ({"dynamics": "guess"}, "dynamics must be one of estimate, ignore, not 'guess'"),
            (
                {"dynamics": Dynamics((5000.0,), (0.01,), (1.0,), 0.0)},
                "the resonance at 5000 Hz is above 35 % of the sampling rate",
            ),
        ),
    ),
    "a recording": (
        lambda **changes: Recording.from_arrays(**{**RECORDED, **changes}),
        (
            ({"y": [1, 2]}, r"vectors of the same length.*\(3,\) and \(2,\)"),
            ({"x": [[1, 2]], "y": [[1, 2]]}, "must be vectors"),
            ({"x": [1, np.nan, 3]}, "arrays: input is missing in sample 1"),
            ({"x": [1, 2, 3, np.nan, np.nan], "y": [1, 2, 3, 4, 5]}, "input is missing in sample 3"),
            ({"x": np.ma.masked_equal([1, 2, 3], 2)}, "input is missing in sample 1"),
            ({"x": [1, 2, 3, 4, 5], "y": [*[np.nan] * 3, 4, 5]}, "in all 3 of 5 values are missing"),
            ({"y": [1, 2, np.inf]}, "output is infinite in sample 2"),
            ({"x": [2, 2, 2]}, "input is constant, all 3 values are 2"),
            ({"sample_time": 0.0}, "the sampling period must be from 1e-09 to 1e.09 s, not 0.0"),
            ({"sample_time": 1e308}, "the sampling period must be from"),
            ({"y": [1e-300, 0, 0]}, "output is constant, all 3 values are 0 to 1e-300"),
            ({"sample_time": np.nan}, "the sampling period must be from 1e-09 to 1e.09 s, not nan"),
        ),
    ),
}
"""Functions, and keywords that they refuse."""

REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    **{
        f"{', '.join(keywords)} of {name}, {case}": (partial(call, **keywords), sentence)
        for name, (call, cases) in OF.items()
        for case, (keywords, sentence) in enumerate(cases)
    },
    # values of another kind
    "one creep rate": (lambda: structure(creep_rates=10.0), r"creep_rates must be a vector, such as \[1.0, 2.0\]"),
    "orders": (lambda: structure(n=5.0), "n must be a whole number from 0 to 1000, not 5.0"),
    "a truth value as order": (lambda: structure(m=True), "m must be a whole number from 0 to 1000, not True"),
    "an order without bound": (lambda: structure(n=10**9), "n must be a whole number from 0 to 1000, not 10"),
    "a range of one number": (lambda: structure(x_range=150.0), "x_range must be two finite numbers in ascending"),
    "a range of three": (lambda: structure(y_range=(0, 1, 2)), "y_range must be two finite numbers that differ"),
    "a word for a time": (lambda: structure(sample_time="1 ms"), "sample_time must be from .*, not '1 ms'"),
    "a number for a unit": (lambda: structure(input_unit=3), "input_unit must be a unit of at most 1000 characters"),
    "words for rates": (lambda: structure(creep_rates=["fast"]), "creep_rates must hold real numbers"),
    "a number as structure": (lambda: identify(DRIVE, OUTPUT, 1e-3), "structure must be a ModelStructure, not 0.001"),
    "a skip in seconds": (lambda: identify(DRIVE, OUTPUT, STRUCTURE, skip=0.5), "skip must be a whole number"),
    "no structure of a basis": (lambda: DataBasis(MODEL), "structure must be a ModelStructure"),
    "a word for forgetting": (lambda: DataBasis(STRUCTURE, forgetting="a"), "forgetting must be above 0 and at most 1"),
    "a structure for a model": (lambda: Compensator(STRUCTURE), "model must be a HysteresisCreepModel, not Model"),
    "limits of one number": (lambda: Compensator(MODEL, 150.0), "x_limits must be two numbers in ascending order, not"),
    "a number for states": (lambda: MODEL.simulate(DRIVE, 0.5), "state must be a OperatorState, not 0.5"),
    "a model for a structure": (lambda: SelfLearningCompensator(MODEL), "structure must be a ModelStructure"),
    "a structure for its model": (lambda: SelfLearningCompensator(STRUCTURE, model=STRUCTURE), "model must be a model"),
    "words for flags": (lambda: SelfLearningCompensator(STRUCTURE, adapt_range="no"), "adapt_range must be True or"),
    "a time of a word": (
        lambda: SelfLearningCompensator(STRUCTURE, forgetting_time_s="2 s"),
        "forgetting_time_s must be a positive",
    ),
    "options of a word": (lambda: SelfLearningCompensator(STRUCTURE, solver_options="a"), "solver_options must be a M"),
    "a count of actuators": (lambda: CompensatorBank(STRUCTURE, 2.0), "count must be a whole number of at least 1"),
    "a folder that is absent": (lambda: BANK.save("absent/bank.json"), "^absent/bank.json: cannot be written: No such"),
    "words for weights": (lambda: HysteresisCreepModel.from_weights(STRUCTURE, "a"), "w must hold real numbers"),
    "limits of a recording": (lambda: Recording.from_arrays([], [], T), "input is constant, all 0 values"),
    "an infinite input": (lambda: Recording.from_arrays([0.0, np.inf], [0.0, 1.0], T), "input is infinite in sample 1"),
    "unequal lengths": (
        lambda: Recording.from_arrays(DRIVE, OUTPUT[:9], T),
        "must be vectors of the same length, not of shapes",
    ),
    # of a bank; ``test_changes`` asks of most of these that it is as it was
    "references of no rows": (
        lambda: BANK.run(np.ones(8)),
        r"y_ref and .* must be of shape \(N, 8\), not of shapes \(8,\) and \(8,\)",
    ),
    "outputs of fewer samples": (lambda: BANK.run(np.ones((5, 8)), np.ones((4, 8))), r"must be of shape \(N, 8\)"),
    "ragged references": (lambda: BANK.run([[1.0], [1.0, 2.0]]), "y_ref must hold real numbers, not list"),
    "words for references": (lambda: BANK.step(["a"] * 8, np.ones(8)), "y_ref must hold real numbers"),
    "no outputs before": (lambda: BANK.step(np.ones(8), None), "y_measured_before must hold real numbers"),
    "the number -1 of an actuator": (lambda: BANK.set_model(-1, MODEL), "actuator must be from 0 to 7, not -1"),
    "the number 8 of eight": (lambda: BANK.set_model(8, MODEL), "actuator must be from 0 to 7, not 8"),
    "a number of no integer": (lambda: BANK.set_model(1.0, MODEL), "actuator must be from 0 to 7, not 1.0"),
    "a number for a model": (lambda: BANK.set_model(0, 3), "model must be a HysteresisCreepModel, not 3"),
    "flags for numbers": (lambda: BANK.remove([True, False]), "actuator must be from 0 to 7, not True"),
    "a number -1 among others": (lambda: BANK.remove([0, -1]), "actuator must be from 0 to 7, not -1"),
    "flags that are written to": (lambda: BANK.learning.__setitem__(3, False), "read-only"),
    "flags of too few": (
        lambda: setattr(BANK, "learning", [True] * 3),
        "learning must be True or False, or an array of 8",
    ),
    "a word for flags": (
        lambda: setattr(BANK, "learning", "no"),
        "learning must be True or False, or an array of 8 of them",
    ),
    "numbers for flags": (lambda: BANK.add(2, learn=[1, 0]), "learn must be True or False, or an array of 2"),
    "one limit of a bank": (
        lambda: BANK.add(2, x_limits=5.0),
        "x_limits must be two numbers, or two arrays of 2, not 5.0",
    ),
    "an infinite limit": (
        lambda: BANK.add(2, x_limits=(0.0, np.inf)),
        r"x_limits\[0\] must be two numbers in ascending order",
    ),
    "limits of three for two": (
        lambda: BANK.add(2, x_limits=(np.zeros(3), 1.0)),
        "x_limits must be two numbers, or two arrays of 2",
    ),
    # and of all others
    **{
        f"states of no number of {name}": (
            lambda make=make: make(state=replace(states(), play=np.full(8, np.nan))),
            r"play\[0\] is not a finite number",
        )
        for name, make in (
            ("a compensator", partial(Compensator, MODEL)),
            ("a learner", partial(SelfLearningCompensator, STRUCTURE)),
        )
    },
    "limits of a compensator": (
        lambda: Compensator(MODEL, (1.0, np.nan)),
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
        for x_start in (-1.0, 101.0, np.nan, np.inf)
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
        lambda: learner_for(PLANT).observe([0.0, np.nan], [0.0, 0.0]),
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
            ("learn_s", np.nan, "a positive number of seconds up to 1e.09, not nan"),
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
        "actuator must be from 0 to 29, not 30",
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
    "a flexure with the lag of an amplifier": (
        lambda: plants.Flexure(PLANT, Dynamics((), (), (), 0.0, 1e-3)),
        "without the lag of an amplifier",
    ),
    "a flexure too fast for its sampling": (
        lambda: plants.Flexure(PLANT, Dynamics((400.0,), (0.1,), (1.0,), 0.0)),
        "above 35 % of the sampling rate",
    ),
    "a start of another structure": (lambda: replace(MODEL, start=ELSEWHERE), "states are those of another structure"),
    "an input that does not exist": (
        lambda: OperatorState.settled_at(STRUCTURE, np.nan),
        "x must be a finite number, not nan",
    ),
    "a direction that does not exist": (
        lambda: OperatorState.settled_at(STRUCTURE, 20.0, "left"),
        "came_from must be 'above', 'below' or None, not 'left'",
    ),
    "an option of a plant": (lambda: plants.get("bouc_wen", lines=3), "'bouc_wen' has no option 'lines'"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_invalid_arguments_are_refused_in_one_sentence(what: str) -> None:
    call, sentence = REFUSED[what]
    with pytest.raises((ValueError, KeyError), match=sentence) as refused:
        call()
    assert "\n" not in str(refused.value)
