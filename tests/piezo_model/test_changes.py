"""A public change of a controller is checked whole, then made whole: what is refused leaves the steps to come as they
would have been, for every way to change one and every kind of wrong value. A stage's delay is asked for wherever a
loop is closed, also where the model is without it."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import asdict, replace
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import reloaded, structure, true_model

from piezo_model import (
    Compensator,
    CompensatorBank,
    Dynamics,
    HysteresisCreepModel,
    ModelError,
    OperatorState,
    SelfLearningCompensator,
    identify,
)

T = 1e-3
S = structure(sample_time=T)
MODEL = replace(true_model(S), sensor_delay_s=2.0 * T)
SHAKY = replace(true_model(S), dynamics=Dynamics((40.0,), (0.002,), (1.0,), T))
NAN, GAIN = np.nan, 30.0
MODE = Dynamics((200.0,), (0.02,), (1.0,), T)
UNSTABLE = replace(MODEL, sensor_delay_s=60.0 * T)


def states(**wrong: Any) -> OperatorState:
    state = OperatorState.settled_at(S, 30.0)
    for name, value in wrong.items():
        getattr(state, name)[1] = value
    return state


CONTROLLERS: dict[str, Callable[[], Any]] = {
    "compensator": partial(Compensator, MODEL, integral_gain=GAIN),
    "compensator with dynamics": partial(Compensator, replace(MODEL, dynamics=MODE), integral_gain=GAIN),
    "continuous learner": partial(
        SelfLearningCompensator, S, model=MODEL, mode="continuous", reset_s=0.01, integral_gain=GAIN
    ),
    "cyclic learner": partial(
        SelfLearningCompensator,
        S,
        model=MODEL,
        mode="cyclic",
        reset_s=0.01,
        build_s=0.1,
        learn_s=0.02,
        solver="box_active_set",
        integral_gain=GAIN,
    ),
    "bank": partial(CompensatorBank, S, 2, integral_gain=GAIN),
    "bank with dynamics": partial(CompensatorBank, S, 2, dynamics=MODE, integral_gain=GAIN),
}
ANOTHER_KIND: dict[str, Any] = {
    "an object": object(),
    "objects": np.array([object()] * 2),
    "words": np.array(["a", "b"]),
    "imaginary": np.full(2, 1j),
    "ragged": [[1.0], [1.0, 2.0]],
}
VALUES: dict[str, Any] = {
    **ANOTHER_KIND,
    "a word": "none",
    "nothing": None,
    "true": True,
    "no number": NAN,
    "endless": np.inf,
    "below zero": -1,
    "beyond doubles": 10**400,
    "none": [],
    "three": [1.0, 2.0, 3.0],
    "no numbers": [NAN, NAN],
    "descending": (1.0, 0.0),
    "a field": {"a": 1},
    "a structure": S,
    "a model of fewer thresholds": true_model(structure(n=2, sample_time=T)),
    "a model of another period": true_model(structure(sample_time=2.0 * T)),
    "a model of other creep": true_model(structure(sample_time=T, creep_rates=(3.0,))),
    "a model of other ranges": replace(MODEL, structure=replace(S, x_scale=2.0 * S.x_scale, y_centre=1.0)),
    "a model of a stage too late": UNSTABLE,
    "a model that would ring": SHAKY.static,
    "a model of two modes": replace(MODEL, dynamics=Dynamics((200.0, 300.0), (0.02, 0.02), (0.5, 0.5), T)),
    "states of no play": states(play=NAN),
    "endless creep": states(creep=np.inf),
    "states of other creep": OperatorState(states().play, np.zeros(8)),
    "a deployment of it": {"format": "piezobench-compensator", "version": 3},
    "the core of another bank": CompensatorBank(replace(S, play_thresholds=S.play_thresholds[:2]), 2).get_state(),
}
Ways = dict[str, tuple[Callable[[Any, Any], Any], set[str]]]
"""How to change a controller, and which of the values are right."""
NUMBERS, A_NUMBER = {"no numbers", "descending"}, {"true", "no number", "endless", "below zero"}
OF_COMPENSATOR: Ways = {
    "state": (lambda c, v: setattr(c, "state", v), set()),
    "model": (lambda c, v: c.change_model(v), {"a model of two modes", "a model of other ranges"}),
    "blend": (lambda c, v: c.change_model(c.model, v), set()),
    "blend time": (lambda c, v: c.set_blend_time(v), set()),
    "references": (lambda c, v: c.run(v), {"none", "three", *NUMBERS}),
    "reference": (lambda c, v: c.step(v), A_NUMBER),
    "output": (lambda c, v: c.correct(v), A_NUMBER),
}
OF_LEARNER: Ways = {
    "actuator": (lambda c, v: c.run([1.0, 2.0], v), set()),
    "references of a run": (lambda c, v: c.run(v, np.sin), {"none", "three", *NUMBERS}),
    "references of drives before the last is observed": (lambda c, v: c.drive(v), set()),
    "an endless drive": (lambda c, v: c.observe([np.inf], [0.0]), set()),
    "outputs of other drives": (lambda c, v: c.observe([1.0], [0.0, 1.0]), set()),
    "drives": (lambda c, v: c.observe(v, [1.0, 2.0]), {"descending"}),
    "outputs": (lambda c, v: c.observe([1.0, 2.0], v), NUMBERS),
    "references": (lambda c, v: c.replay(v, [1.0, 2.0]), NUMBERS),
    "outputs before": (lambda c, v: c.replay([1.0, 2.0], v), NUMBERS),
    "reference": (lambda c, v: c.step(v, 1.0), A_NUMBER),
    "output before": (lambda c, v: c.step(1.0, v), A_NUMBER),
}
OF_BANK: Ways = {
    "model": (lambda b, v: b.set_model(1, v), set()),
    "whose model": (lambda b, v: b.set_model(v, b.models[0]), {"none"}),
    "removed": (lambda b, v: b.remove(v), {"none"}),
    "added": (lambda b, v: b.add(v), set()),
    "limits": (lambda b, v: b.add(20, v), {"nothing"}),
    "upper limit": (lambda b, v: b.add(20, (0.0, v)), {"true"}),
    "start": (lambda b, v: b.add(20, x_start=v), {"nothing", "true"}),
    "learning of more": (lambda b, v: b.add(20, learn=v), {"true"}),
    "learning": (lambda b, v: setattr(b, "learning", v), {"true"}),
    "a flag too few": (lambda b, v: b.add(20, learn=[True] * 19), set()),
    "a model of dynamics without room": (lambda b, v: b.set_model(1, replace(SHAKY, left_out=MODEL.dynamics)), set()),
    "a model for one more": (lambda b, v: b.set_model([0, 2], b.models[0]), set()),
    "one more is removed": (lambda b, v: b.remove([0, 2]), set()),
    "references": (lambda b, v: b.step(v, [1.0, 2.0]), NUMBERS),
    "outputs before": (lambda b, v: b.step([1.0, 2.0], v), NUMBERS),
}
WAYS = {"compensator": OF_COMPENSATOR, "learner": OF_LEARNER, "bank": OF_BANK}
IN_PLACE: dict[str, Callable[[Any], Any]] = {
    "a number of it is none": lambda v: np.where(np.arange(len(v)) == 2, NAN, v),
    "an endless number in it": lambda v: np.where(np.arange(len(v)) == 0, np.inf, v),
    "all its bits": lambda v: np.full(v.shape, 255, v.dtype),
    "one less": lambda v: v[:-1],
    "the first again": lambda v: np.append(v[:1], v[:-1]),
    "negative": lambda v: -v,
    "half as much again": lambda v: v + 1.5,
}
"""Wrong values that are made of the right one."""


def fields(state: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Path of everything in a state, of lists the first only, with the state itself."""
    yield path
    inner = state.items() if isinstance(state, dict) else enumerate(state[:1]) if isinstance(state, list) else ()
    for name, value in inner:
        yield from fields(value, (*path, name))


CONTRADICTED: dict[str, tuple[tuple[tuple[Any, ...], Any], ...]] = {
    "compensator": (
        (("play", 2), NAN),
        (("creep",), np.zeros(8)),
        (("drive",), np.zeros(5)),
        (("drive",), np.array(["a"] * 6)),
        (("drive", 0), np.inf),
        (("decay",), 1.5),
        (("prefilter",), np.zeros(3)),
        (("model",), UNSTABLE.to_dict()),
        (("model", "w_H"), [0.0] * (S.n + 1)),
    ),
    "continuous learner": (
        (("compensator",), Compensator(true_model(structure(n=2, sample_time=T))).get_state()),
        (("compensator",), Compensator(SHAKY, integral_gain=1.0).get_state()),
        (("compensator", "play", 1), NAN),
        (("compensator", "prefilter"), np.zeros(3)),
        (("compensator", "decay"), 0.5),
        (("learning", "core"), np.zeros(64, np.uint8)),
        (("learning", "driven"), {"spans": [], "observed": 7}),
        (("log",), "none"),
        (("last_x",), NAN),
    ),
    "bank": (
        (("slots",), np.zeros(2, np.int64)),
        (("slots",), [0, 1]),
        (("core",), None),
        (("dynamics",), [asdict(SHAKY.known_dynamics)] * 2),
        (("dynamics",), np.ones((2, 3))),
        (("dynamics",), [None]),
    ),
}
"""Values of fields of a state that the others contradict."""


RUNS: dict[type, Callable[[Any, np.ndarray], np.ndarray]] = {
    Compensator: lambda one, y: one.run(y),
    SelfLearningCompensator: lambda one, y: one.replay(y, y - 0.01),
    CompensatorBank: lambda one, y: one.run(y[:, None].repeat(len(one), 1), y[:, None].repeat(len(one), 1) - 0.01),
}


class Twins:
    """A controller that is changed, and one that is left alone."""

    def __init__(self, name: str) -> None:
        self.changed, self.other = CONTROLLERS[name](), CONTROLLERS[name]()
        self.run(self.changed, 130), self.run(self.other, 130)
        self.good = self.other.get_state()

    @staticmethod
    def run(one: Any, samples: int) -> np.ndarray:
        return RUNS[type(one)](one, 5.0 + np.sin(np.arange(samples) / 3.0))

    def refuses(self, change: Callable[[], Any]) -> bool:
        """Whether a change is refused, after which both go on alike for two steps; else drives stay finite."""
        try:
            change()
        except ValueError:
            np.testing.assert_equal(self.changed.get_state(), self.other.get_state())
            np.testing.assert_array_equal(self.run(self.changed, 2), self.run(self.other, 2))
            return True
        assert np.all(np.isfinite(self.run(self.changed, 2)))
        return False


@pytest.mark.parametrize(
    ("name", "way"), [(name, way) for name in CONTROLLERS for kind in WAYS if kind in name for way in WAYS[kind]]
)
def test_a_wrong_value_is_refused_and_leaves_the_next_steps_as_they_would_have_been(name: str, way: str) -> None:
    twins = Twins(name)
    change, right = next(ways for kind, ways in WAYS.items() if kind in name)[way]
    for value in sorted(VALUES.keys() - right):
        assert twins.refuses(lambda value=value: change(twins.changed, VALUES[value])), value


@pytest.mark.parametrize("name", [name for name in CONTROLLERS if "learner" in name])
def test_what_is_done_to_the_compensator_that_a_learner_shows_changes_nothing_of_the_learner(name: str) -> None:
    twins = Twins(name)
    one = twins.changed.compensator
    np.testing.assert_equal(one.get_state(), twins.good["compensator"])
    one.change_model(HysteresisCreepModel.from_weights(S, S.straight_line), 0.01)
    one.state = states()
    one.correct(1.0)
    assert np.isfinite(one.run([1.0, 2.0])).all()
    np.testing.assert_equal(twins.changed.get_state(), twins.good)
    np.testing.assert_array_equal(twins.run(twins.changed, 200), twins.run(twins.other, 200))


@pytest.mark.parametrize("name", CONTRADICTED)
def test_a_state_that_contradicts_itself_is_refused_whole(name: str) -> None:
    twins = Twins(name)
    for (*inner, last), value in CONTRADICTED[name]:
        state = deepcopy(twins.good)
        reduce(lambda part, step: part[step], inner, state)[last] = value
        assert twins.refuses(lambda state=state: twins.changed.restore(state)), (*inner, last)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_state_with_anything_wrong_in_it_is_refused_whole(name: str) -> None:
    twins = Twins(name)
    wrong = {
        **{
            name: lambda _, v=v: v
            for name, v in VALUES.items()
            if not isinstance(v, HysteresisCreepModel | OperatorState)
        },
        **IN_PLACE,
    }
    twins.changed.restore(twins.good)
    for path in fields(twins.good):
        for value, made in wrong.items():
            state, (*inner, last) = {"": deepcopy(twins.good)}, ("", *path)
            holder = reduce(lambda part, step: part[step], inner, state)
            if value in VALUES or isinstance(holder[last], np.ndarray):
                holder[last] = made(holder[last])
            refused = twins.refuses(lambda state=state: twins.changed.restore(state[""]))
            assert refused or value not in ANOTHER_KIND, (path, value)
            if not refused:
                twins.changed.restore(twins.good), twins.other.restore(twins.good)


@pytest.mark.parametrize(
    "choice", [{}, {"lag": "remove"}, {"dynamics": "ignore"}], ids=["in the model", "removed", "ignored"]
)
def test_a_gain_is_refused_beside_the_lag_that_the_loop_has_whatever_became_of_it(
    choice: dict[str, str], tmp_path: Path
) -> None:
    x = np.repeat(np.random.default_rng(2).uniform(2.0, 98.0, 80), 100)
    model = identify(x, np.pad(true_model(S).simulate(x)[:-3], (3, 0), "edge"), S, **choice)  # three samples late
    assert (model.dynamics is None) == bool(choice)
    most = model.require_stable(1.0, inverts=False)
    assert 100.0 < most < 500.0
    bank = CompensatorBank(S, 1, dynamics=model.dynamics)
    bank.set_model(0, model)
    same = (model, model.static, model.at(5e-4), reloaded(model, tmp_path), *reloaded(bank, tmp_path).models)
    assert [each.require_stable(1.0, inverts=False) for each in same] == pytest.approx([most] * 5, rel=0.2)
    with pytest.raises(ModelError, match=r"integral_gain must be below .* with a delay of 3"):
        Compensator(model, integral_gain=1.1 * most, dynamics=False)
    fits = Compensator(model, integral_gain=0.5 * most, dynamics=False)
    for unstable in (Dynamics((), (), (), 30.0 * T), Dynamics((1e-10 / T,), (0.02,), (1.0,), 0.0)):
        with pytest.raises(ModelError, match="integral_gain must be below"):
            fits.change_model(replace(model, dynamics=None, left_out=unstable, sensor_delay_s=0.0))
