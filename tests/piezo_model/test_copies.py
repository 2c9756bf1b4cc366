"""Copies and files of every object with a state: by ``copy`` and ``pickle`` the same bits from then on, and nothing
shared; whatever is saved can be loaded, and what a file cannot hold is refused first, by its name."""

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import reloaded
from learning_loops import MODEL, MODES, PLANT, STRUCTURE, T, learner_for, sensor

from piezo_model import (
    Compensator,
    CompensatorBank,
    DataBasis,
    Dynamics,
    HysteresisCreepModel,
    OperatorState,
    Recording,
    SelfLearningCompensator,
    plants,
)

RINGING = Dynamics((30.0,), (0.02,), (0.9,), 0.5 * T)
COPIES: dict[str, Callable[[Any], Any]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
}
each_way = pytest.mark.parametrize("way", COPIES)


def signal(seed: int, *shape: int) -> np.ndarray:
    """Slow random signals in −1 to 1 with a little noise, along the first axis."""
    random = np.random.default_rng(seed)
    phase = random.uniform(0.0, 6.0, shape[1:]) + random.uniform(0.02, 0.05) * np.arange(shape[0]).reshape(
        -1, *[1] * (len(shape) - 1)
    )
    return 0.9 * np.sin(phase) + 0.01 * random.normal(size=shape)


def volts(u: np.ndarray) -> np.ndarray:
    return 75.0 + 75.0 * u


def update(basis: DataBasis, seed: int) -> Any:
    basis.update(volts(signal(seed, 333)), 20.0 * signal(seed, 333))
    return basis.P, basis.q, basis.c, basis.samples, basis.state.play, basis.excitation


def learn(learner: Any, seed: int) -> Any:
    y_ref = 20.0 * signal(seed, 1500)
    x = learner.replay(y_ref, y_ref + 0.1 * signal(seed + 1, 1500))
    return x, learner.samples, learner.counts, learner.learned_weights, [asdict(event) for event in learner.log]


def run_bank(bank: CompensatorBank, seed: int) -> Any:
    y_ref = 20.0 * signal(seed, 600, len(bank))
    return bank.run(y_ref, y_ref + 0.1 * signal(seed + 1, 600, len(bank))), bank.weights, bank.counts, bank.learning


def move_states(state: OperatorState, seed: int) -> Any:
    before = state.play.copy(), state.creep.copy()
    state.play[:], state.creep[:] = signal(seed, state.play.size), signal(seed, state.creep.size)
    return before


CASES: dict[str, tuple[Callable[[], Any], Callable[[Any, int], Any]]] = {
    **{
        f"a compensator, {name}": (
            partial(Compensator, model, (0.0, 150.0), rate_limit=1e5, integral_gain=5.0),
            lambda one, seed: [(one.step(y), one.correct(y + 0.1)) for y in (20.0 * signal(seed, 100)).tolist()],
        )
        for name, model in (("static", MODEL), ("ringing", replace(MODEL, dynamics=RINGING)))
    },
    "a data basis": (lambda: DataBasis(STRUCTURE, forgetting=0.999), update),
    **{f"a learner, {mode}": (partial(learner_for, PLANT, mode, build_s=1.0), learn) for mode in MODES},
    **{
        f"a bank of {threads} threads": (partial(CompensatorBank, STRUCTURE, 19, threads=threads), run_bank)
        for threads in (1, 2)
    },
    **{
        f"the plant {name}": (
            partial(plants.get, name, sample_time=T),
            lambda plant, seed: plant.run(volts(signal(seed, 200))),
        )
        for name in plants.names()
    },
    "a sensor": (partial(sensor, delay_samples=3), lambda one, seed: one.run(volts(signal(seed, 200)))),
    "a flexure": (
        lambda: plants.Flexure(plants.get("bouc_wen", sample_time=T), RINGING),
        lambda plant, seed: plant.run(volts(signal(seed, 200))),
    ),
    "states of operators": (partial(OperatorState.settled_at, STRUCTURE, 40.0, "above"), move_states),
    "a recording": (
        lambda: Recording.from_arrays(volts(signal(0, 200)), 20.0 * signal(0, 200), T, name="here"),
        lambda recording, seed: (recording.digest(), recording.describe()),
    ),
    "a model": (lambda: MODEL, lambda model, seed: (model.simulate(volts(signal(seed, 200))), model.to_dict())),
}
"""What makes an object, and a use of it that returns what can be seen."""


@each_way
@pytest.mark.parametrize("what", CASES)
def test_a_copy_goes_on_as_the_original_would_and_neither_disturbs_the_other(what: str, way: str) -> None:
    (make, use), again = CASES[what], COPIES[way]
    original, alike = make(), make()
    for thing in (original, alike):
        use(thing, 100)  # into the middle of its work
    one, other = again(original), again(original)
    use(one, 1)
    expected = use(alike, 2)
    np.testing.assert_equal([use(other, 2), use(original, 2)], [expected, expected])
    # … and on: what one of them learned is of no effect on the others
    np.testing.assert_equal(use(again(other), 3), use(original, 3))


@each_way
def test_a_copied_bank_has_settings_of_its_own(way: str) -> None:
    bank = CompensatorBank(STRUCTURE, 19)
    other = COPIES[way](bank)
    other.learning = False
    other.set_model(3, HysteresisCreepModel.from_weights(STRUCTURE, 2.0 * STRUCTURE.straight_line))
    other.add(30)
    other.remove(0)
    assert (len(bank), bank.learning.all()) == (19, True)
    np.testing.assert_array_equal(bank.weights, CompensatorBank(STRUCTURE, 19).weights)


IN_USE: dict[str, Callable[[CompensatorBank], object]] = {
    "copied": copy.copy,
    "run": lambda bank: bank.run(np.zeros((1, 8))),
    "made longer": lambda bank: bank.add(1),
    "made shorter": lambda bank: bank.remove(0),
    "given a model": lambda bank: bank.set_model(0, MODEL),
    "switched off": lambda bank: setattr(bank, "learning", False),
    "saved": CompensatorBank.get_state,
    "restored": lambda bank: bank.restore(CompensatorBank(STRUCTURE, 8).get_state()),
}


@pytest.mark.parametrize("how", IN_USE)
def test_a_bank_in_use_by_another_thread_is_not(how: str) -> None:
    bank = CompensatorBank(STRUCTURE, 8)
    before = bank.get_state()
    with bank._core.exclusive(), ThreadPoolExecutor(1) as other:
        refused = other.submit(IN_USE[how], bank).exception()
    assert isinstance(refused, RuntimeError)
    assert "in use by another thread" in str(refused)
    np.testing.assert_array_equal(bank.get_state()["core"], before["core"])


STATES = OperatorState.settled_at(STRUCTURE, 75.0)


learner, bank, model = (
    partial(SelfLearningCompensator, STRUCTURE),
    partial(CompensatorBank, STRUCTURE, 2),
    partial(replace, MODEL),
)


@pytest.mark.parametrize(
    ("make", "options"),
    [
        *(
            (learner, {"mode": mode, name: value})
            for mode in MODES
            for name, value in (
                ("x_limits", np.array([0, 150])),
                ("x_limits", (np.float32(0), np.int64(150))),
                ("rate_limit", np.float32(0.1)),
                ("forgetting_time_s", np.float32(0.7)),
                ("hand_over_s", np.float32(0.03)),
                ("integral_gain", np.float32(0.1)),
                ("proximal", np.float32(0.1)),
                ("solve_delay_samples", np.int64(3)),
                ("estimate_offset", np.True_),
                ("solver_options", {"step_ratio": np.float32(0.3)}),
            )
        ),
        (bank, {"x_limits": (np.float32(0), np.array([100, 150]))}),
        (bank, {"forgetting_time_s": np.float32(0.7), "integral_gain": np.float32(0.1), "rate_limit": np.int64(5)}),
        (model, {"report": {"rms": np.float32(0.1), "runs": np.int64(3), "nested": {"all": [np.True_, (1, 2)]}}}),
        (model, {"report": {"curve": np.arange(3.0), "lag": np.nan, 3: None}}),
        (model, {"w_H": MODEL.w_H.astype(np.float32), "offset": np.float32(0.1), "start": STATES}),
    ],
)
def test_numbers_of_numpy_are_saved_and_loaded(
    make: Callable[..., Any], options: dict[str, Any], tmp_path: Path
) -> None:
    one = make(**options)
    other = reloaded(one, tmp_path)
    other.save(tmp_path / "again")
    if make is not bank:
        assert (tmp_path / "again").read_text() == (tmp_path / "saved").read_text()
    else:
        np.testing.assert_equal(other.get_state(), one.get_state())
        assert other.settings == one.settings


def test_arrays_and_infinite_numbers_of_a_report_return_as_they_were(tmp_path: Path) -> None:
    report = {"curve": np.arange(3.0), "gap": -np.inf, "lag": np.nan}
    np.testing.assert_equal(dict(reloaded(model(report=report), tmp_path).report), report)


@pytest.mark.parametrize(
    ("make", "options", "sentence"),
    [
        *(
            (learner, {"mode": mode, name: value}, f"{name} .*must be ")
            for mode in MODES
            for name, value in (
                ("x_limits", (-np.inf, np.inf)),
                ("x_limits", (-1e200, 1e200)),
                ("rate_limit", np.inf),
                ("rate_limit", True),
                ("forgetting_time_s", np.inf),
                ("integral_gain", np.inf),
                ("solve_delay_samples", True),
                ("estimate_offset", "no"),
            )
        ),
        (
            learner,
            {"mode": "continuous", "solver_options": {"hook": print}},
            "solver_options.hook is a builtin_function",
        ),
        (bank, {"x_limits": (-np.inf, np.inf)}, r"x_limits\[0\] must be two numbers in ascending order, both finite"),
        (bank, {"rate_limit": np.inf}, "rate_limit must be above 0"),
        (bank, {"learn": "no"}, "learn must be True or False"),
        (model, {"report": {"fit": {"hook": print}}}, "report.fit.hook is a builtin_function_or_method, which a file"),
        (model, {"report": {"names": {"a", "b"}}}, "report.names is a set, which a file cannot hold"),
        (model, {"report": {"z": np.array([1j])}}, "report.z is a ndarray, which a file cannot hold"),
        (model, {"w_H": 1e150 * MODEL.w_H}, r"w_H\[0\] is not a finite number"),
        (model, {"offset": 1e200}, "offset must be above"),
        (model, {"start": OperatorState(np.full(8, np.nan), STATES.creep)}, r"play\[0\] is not a finite number"),
    ],
)
def test_what_a_file_cannot_hold_is_refused_by_its_name_and_the_file_stays(
    make: Callable[..., Any], options: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("an older file")
    with pytest.raises(ValueError, match=sentence) as refused:
        make(**options).save(tmp_path / "file")
    assert "\n" not in str(refused.value)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("file", "an older file")]
