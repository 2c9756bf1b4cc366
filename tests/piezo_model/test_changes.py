"""A public change of a controller is checked whole, then made whole: what is refused leaves the steps to come as they
would have been. A stage's delay is asked for wherever a loop is closed, also where the model is without it."""

import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import structure, true_model

from piezo_model import (
    Compensator,
    CompensatorBank,
    Dynamics,
    HysteresisCreepModel,
    OperatorState,
    SelfLearningCompensator,
    identify,
)
from piezo_model.model import ModelError

T = 1e-3
S = structure(sample_time=T)
MODEL = replace(true_model(S), sensor_delay_s=2.0 * T)
SHAKY = replace(true_model(S), dynamics=Dynamics((40.0,), (0.002,), (1.0,), T))
NAN, GAIN = np.nan, 30.0
UNSTABLE = replace(MODEL, sensor_delay_s=60.0 * T)


def states(**wrong: Any) -> OperatorState:
    state = OperatorState.settled_at(S, 30.0)
    for name, value in wrong.items():
        getattr(state, name)[1] = value
    return state


def compensator() -> Compensator:
    return Compensator(MODEL, integral_gain=GAIN)


def learner() -> SelfLearningCompensator:
    return SelfLearningCompensator(S, model=MODEL, mode="continuous", reset_s=0.01, integral_gain=GAIN)


def bank() -> CompensatorBank:
    return CompensatorBank(S, 2, integral_gain=GAIN)


RUNS: dict[Callable[[], Any], Callable[[Any, np.ndarray], np.ndarray]] = {
    compensator: lambda one, y: one.run(y),
    learner: lambda one, y: one.replay(y, y - 0.01),
    bank: lambda one, y: one.run(np.column_stack([y, y]), np.column_stack([y, y]) - 0.01),
}


def restored(*path: Any, value: Any) -> Callable[[Any], Any]:
    """To go on from the controller's own state in which something is wrong."""

    def restore(controller: Any) -> None:
        state = inner = deepcopy(controller.get_state())
        for name in path[:-1]:
            inner = inner[name]
        inner[path[-1]] = value(inner[path[-1]]) if callable(value) else value
        controller.restore(state)

    return restore


OTHER = CompensatorBank(replace(S, play_thresholds=S.play_thresholds[:2]), 2).get_state()
OF_COMPENSATOR: dict[str, Callable[[Any], Any]] = {
    "states of no number": lambda c: setattr(c, "state", states(play=NAN)),
    "endless creep": lambda c: setattr(c, "state", states(creep=np.inf)),
    "a state that was handed out": lambda c: setattr(c, "state", replace(c.state, play=c.state.play.__imul__(NAN))),
    "no states": lambda c: setattr(c, "state", 3.0),
    "no model": lambda c: c.change_model(S),
    "a model of other creep": lambda c: c.change_model(true_model(structure(sample_time=T, creep_rates=(3.0,)))),
    "a model of a stage too late": lambda c: c.change_model(UNSTABLE),
    "a model that would ring": lambda c: c.change_model(SHAKY.static),
    "a blend of no time": lambda c: c.change_model(MODEL, NAN),
    "a blend backwards": lambda c: c.set_blend_time(-1.0),
    "nothing": lambda c: c.restore({}),
    "a state of no play": restored("play", 2, value=NAN),
    "of other creep": restored("creep", value=np.zeros(8)),
    "of a drive of five": restored("drive", value=np.zeros(5)),
    "of a drive in words": restored("drive", value=np.array(["a"] * 6)),
    "of an endless bump": restored("drive", 0, value=np.inf),
    "of a growing bump": restored("decay", value=1.5),
    "of dynamics that are none": restored("prefilter", value=np.zeros(3)),
    "of a stage too late": restored("model", value=UNSTABLE.to_dict()),
    "of no model": restored("model", "w_H", value=[0.0] * (S.n + 1)),
}
OF_LEARNER: dict[str, Callable[[Any], Any]] = {
    "nothing": lambda c: c.restore({}),
    "of another structure": restored(
        "compensator", value=Compensator(true_model(structure(n=2, sample_time=T))).get_state()
    ),
    "of other dynamics": restored("compensator", value=Compensator(SHAKY, integral_gain=1.0).get_state()),
    "of no play": restored("compensator", "play", 1, value=NAN),
    "of other dynamics of its own": restored("compensator", "prefilter", value=np.zeros(3)),
    "of a core of another size": restored("learning", "core", value=np.zeros(64, np.uint8)),
    "of weights of no number": restored("learning", "core", value=lambda core: np.full_like(core, 255)),
    "of half a piece without a span": restored("learning", "driven", value={"spans": [], "observed": 7}),
    "of a log in words": restored("log", value="none"),
    "of a last drive of no number": restored("last_x", value=NAN),
    "an endless drive": lambda c: c.observe([np.inf], [0.0]),
    "outputs of other drives": lambda c: c.observe([1.0], [0.0, 1.0]),
}
OF_BANK: dict[str, Callable[[Any], Any]] = {
    "a model of a stage too late": lambda b: b.set_model(1, UNSTABLE),
    "a model of dynamics without room": lambda b: b.set_model(1, replace(SHAKY, left_out=MODEL.dynamics)),
    "a model for one more": lambda b: b.set_model([0, 2], MODEL),
    "one more that begins nowhere": lambda b: b.add(1, x_start=NAN),
    "twenty more with a flag too few": lambda b: b.add(20, learn=[True] * 19),
    "the same actuator twice": restored("slots", value=np.zeros(2, np.int64)),
    "slots that are no array": restored("slots", value=[0, 1]),
    "no core": lambda b: b.restore({"slots": b.get_state()["slots"]}),
    "of dynamics": restored("dynamics", value=[SHAKY.dynamics.to_dict()] * 2),
    "of dynamics in numbers": restored("dynamics", value=np.ones((2, 3))),
    "of one actuator's dynamics": restored("dynamics", value=[None]),
    "of another structure": lambda b: b.restore(OTHER),
}
WAYS = {compensator: OF_COMPENSATOR, learner: OF_LEARNER, bank: OF_BANK}


@pytest.mark.parametrize(("make", "name"), [(make, name) for make, ways in WAYS.items() for name in ways])
def test_a_change_that_is_refused_leaves_the_next_steps_as_they_would_have_been(
    make: Callable[[], Any], name: str
) -> None:
    changed, other, run = make(), make(), RUNS[make]
    y_ref = 5.0 + np.sin(np.arange(30) / 3.0)
    run(changed, y_ref), run(other, y_ref)
    with pytest.raises(ValueError, match=r"\w"):
        WAYS[make][name](changed)
    np.testing.assert_array_equal(run(changed, y_ref[:3]), run(other, y_ref[:3]))
    np.testing.assert_equal(changed.get_state(), other.get_state())


@pytest.mark.parametrize(
    "make", [Compensator, lambda model, state: SelfLearningCompensator(S, model=model, state=state)]
)
def test_no_controller_begins_with_states_of_no_number(make: Callable[..., Any]) -> None:
    with pytest.raises(ValueError, match=r"play\[1\] is not a finite number"):
        make(MODEL, state=states(play=NAN))


@pytest.fixture(scope="module")
def late() -> dict[str, HysteresisCreepModel]:
    """Models of one recording that is three samples late, by what was to become of the lag."""
    x = np.repeat(np.random.default_rng(2).uniform(2.0, 98.0, 80), 100)
    y = np.r_[np.zeros(3), true_model(S).simulate(x)[:-3]]
    y[:3] = y[3]
    choices: dict[str, dict[str, Any]] = {
        "in the model": {},
        "removed": {"lag": "remove"},
        "ignored": {"dynamics": "ignore"},
    }
    return {name: identify(x, y, S, **choice) for name, choice in choices.items()}


@pytest.mark.parametrize("choice", ["in the model", "removed", "ignored"])
def test_a_gain_is_refused_beside_the_lag_that_the_loop_has_whatever_became_of_it(
    late: dict[str, HysteresisCreepModel], choice: str, tmp_path: Path
) -> None:
    model = late[choice]
    assert (model.dynamics is None) == (choice != "in the model")
    most = model.require_stable(1.0, inverts=False)
    assert 100.0 < most < 500.0
    model.save(tmp_path / "model.json")
    for same in (model, model.static, model.at(5e-4), HysteresisCreepModel.load(tmp_path / "model.json")):
        assert same.require_stable(1.0, inverts=False) == pytest.approx(most, rel=0.2)
    with pytest.raises(ModelError, match=r"integral_gain must be below .* beside a delay of 3"):
        Compensator(model, integral_gain=1.1 * most, dynamics=False)
    fits = Compensator(model, integral_gain=0.5 * most, dynamics=False)
    with pytest.raises(ModelError, match="integral_gain must be below"):
        fits.change_model(replace(model, dynamics=None, left_out=Dynamics((), (), (), 30.0 * T), sensor_delay_s=0.0))


def test_a_model_of_the_version_before_has_the_lag_that_was_removed(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    earlier = {k: v for k, v in MODEL.to_dict().items() if k not in ("left_out", "sensor_delay_s")}

    def opened(report: dict[str, Any]) -> HysteresisCreepModel:
        path.write_text(json.dumps({**earlier, "version": 2, "report": report}))
        return HysteresisCreepModel.load(path)

    assert opened({"lag": {"samples": 2.0, "removed": True}}).sensor_delay_s == 2.0 * T
    assert opened({"lag": {"samples": 2.0, "removed": False}}).sensor_delay_s == 0.0
    assert opened({"left_out_dynamics": Dynamics((), (), (), T).to_dict()}).left_out == Dynamics((), (), (), T)
    with pytest.raises(ModelError, match=r"model\.json: expected `float`"):
        opened({"lag": {"removed": True}})
