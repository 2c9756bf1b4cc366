"""The self-learning compensator as a whole; behaviour common to both modes is tested in both."""

import json
import pickle
import re
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from functools import partial, reduce
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from actuators import straight_lines
from learning_loops import (
    MODES,
    NOISE,
    WAYS,
    FaultySensor,
    T,
    at_work,
    error_of,
    learner_for,
    rms_percent,
    sensor,
    spoiled,
    steps,
    stretched,
    structure_for,
)
from programs import ALL
from qpsolvers import Problem

from piezo_model import (
    CompensatorBank,
    Dynamics,
    HysteresisCreepModel,
    ModelError,
    SelfLearningCompensator,
    plants,
)
from piezo_model.learning.events import Phase
from piezo_model.learning.learner_file import read_learner, write_learner
from piezo_model.solving import solved
from solvers.kernel.box_active_set import BoxActiveSet
from solvers.registry import Entry

RATE_LIMIT = 2e4


def fresh(mode: str = "cyclic", solver: str = "box_active_set") -> SelfLearningCompensator:
    return learner_for(sensor(), mode, solver, offset=mode == "continuous", build_s=2.0, solve_delay_samples=200)


a_bank = partial(CompensatorBank, structure_for(sensor()), 13)


# Sample by sample and in runs


RINGS = Dynamics((60.0,), (0.02,), (0.9,), 1.5 * T)


def narrow(mode: str, dynamics: Dynamics | None = None) -> SelfLearningCompensator:
    """A learner whose ranges are half of the true ones, so that it widens them."""
    half = stretched(0.5)
    line = replace(HysteresisCreepModel.from_weights(half, half.straight_line), dynamics=dynamics)
    options: dict[str, Any] = {"hand_over_s": 0.02, "solve_delay_samples": 200}
    options |= {"model": line, "adapt_range": True, "integral_gain": 5.0, "rate_limit": RATE_LIMIT} if dynamics else {}
    return SelfLearningCompensator(half, 0.1, 2.0, 0.2, "box_active_set", sensor().x_range, mode, **options)


LEARNERS: dict[str, Callable[[], SelfLearningCompensator]] = {
    **{f"{mode}, {solver}": partial(fresh, mode, solver) for mode, solver in WAYS},
    **{f"{mode}, narrow": partial(narrow, mode) for mode in MODES},
    **{f"{mode}, narrow, ringing": partial(narrow, mode, RINGS) for mode in MODES},
}


@pytest.mark.parametrize("name", LEARNERS)
def test_runs_and_replays_saved_in_the_middle_of_any_phase_equal_single_steps_bit_for_bit_through_a_gap_and_a_jump(
    name: str, tmp_path: Path
) -> None:
    make, rings = LEARNERS[name], "ringing" in name
    one, two = (plants.Flexure(sensor(), RINGS) if rings else sensor() for _ in range(2))
    y_ref, added, stepped, ran, before = steps(one, 12.0), np.zeros(12_000), make(), make(), [np.nan]
    y_ref[3000:3020], added[1000:1010], added[6000:6080] = np.nan, np.nan, 15.0
    for y, error in zip(y_ref.tolist(), added.tolist(), strict=True):
        before.append(two.step(stepped.step(y, before[-1])) + error)
    errors = iter(added)
    x, y = np.hstack(
        [
            ran.run(part, lambda x: np.add(one.run(x), [*islice(errors, x.size)]))
            for part in np.split(y_ref, range(37, y_ref.size, 501))  # which begin within blocks, too
        ]
    )
    np.testing.assert_array_equal(y, before[1:])
    replayed, parts, phases = make(), [], set()
    for start, stop in pairwise((0, 50, 1005, 1500, 1850, 2090, 2200, 2300, 5000, 6010, 6050, 6100, 8000, 12_000)):
        parts.append(replayed.replay(y_ref[start:stop], np.array(before[start:stop])))
        phases.add(replayed.phase)
        replayed.save(tmp_path / "learner.json")
        replayed = SelfLearningCompensator.load(tmp_path / "learner.json")
    np.testing.assert_array_equal(np.concatenate(parts), x)
    assert replayed.counts == stepped.counts
    assert [event.message for event in replayed.log] == [event.message for event in stepped.log]
    assert {Phase.RESET, Phase.LEARN} <= phases
    assert {"hand-over", "sensor", *(["range"] if "narrow" in name else [])} <= {event.what for event in stepped.log}
    assert (stepped.model.dynamics == RINGS) == rings


@pytest.mark.parametrize("integral_gain", [0.0, 20.0])
@pytest.mark.parametrize(("mode", "solver"), WAYS)
def test_an_actuator_that_fails_in_a_run_leaves_the_state_that_steps_without_its_outputs_leave(
    mode: str, solver: str, integral_gain: float
) -> None:
    one, given, before = sensor(), [], [np.nan]
    y_ref = steps(one, 4.0)

    def unplugged(x: np.ndarray) -> np.ndarray:
        given.extend(x)
        if len(given) > 3000:
            raise OSError("unplugged")
        before.extend(one.run(x))
        return np.array(before[-x.size :])

    ran, stepped = (learner_for(one, mode, solver, build_s=1.0, integral_gain=integral_gain) for _ in range(2))
    with pytest.raises(OSError, match="unplugged"):
        ran.run(y_ref, unplugged)
    before += [np.nan] * (len(given) - len(before))
    assert given == [stepped.step(*sample) for sample in zip(y_ref.tolist(), before, strict=False)]
    stepped.run([], unplugged)  # the output of the last step is missing, too
    with pytest.raises(ValueError, match="the output of the actuator must hold real numbers, not list"):
        ran.run(y_ref[:1], lambda x: [None])  # type: ignore[list-item, return-value]
    with pytest.raises(ValueError, match=r"drive takes at most samples_until_change\(\) references"):
        stepped.drive(y_ref[: stepped.samples_until_change() + 1])
    stepped.observe(stepped.drive(y_ref[:1]), [np.nan])
    for part in ("compensator", "last_x", "log"):
        np.testing.assert_equal(ran.get_state()[part], stepped.get_state()[part])
    again = deepcopy(one)
    np.testing.assert_array_equal(ran.run(y_ref, one.run), stepped.run(y_ref, again.run))
    assert ran.counts == stepped.counts


def test_equal_learners_have_the_same_bytes_regardless_of_earlier_computations() -> None:
    plant = sensor("bouc_wen")
    states = set()
    for size in range(1, 40, 3):
        rng = np.random.default_rng(size)  # leaves different numbers on the stack each time
        np.linalg.svd(rng.normal(size=(size, size)))
        learner = SelfLearningCompensator(structure_for(plant, n=3, m=1), build_s=0.5, learn_s=0.1)
        states.add(pickle.dumps(learner.get_state()))
        plant.run(rng.normal(size=size))
    assert len(states) == 1


# Files


@pytest.mark.parametrize("make", [*(partial(fresh, mode) for mode in MODES), a_bank])
def test_every_damage_of_a_saved_file_is_refused_in_one_sentence_that_names_it(
    make: Callable[[], Any], tmp_path: Path
) -> None:
    path, one = tmp_path / "learner.json", make()
    if make is not a_bank:
        one.run(steps(sensor(), 2.5), sensor().run)
    one.save(path)
    text, random = path.read_text(), np.random.default_rng(0)
    changed = (
        text[:at] + ("1" if text[at] != "1" else "2") + text[at + 1 :]
        for at in random.integers(0, len(text) - 1, 60)
        if text[at].isalnum()
    )
    for content in (text[: len(text) // 2], "", "[]", '{"format": "piezobench-model"}', *changed):
        path.write_text(content)
        with pytest.raises(ModelError, match=r"^[^\n]*learner\.json: [^\n]*$"):
            type(one).load(path)
    with pytest.raises(ModelError, match=r"nowhere\.json: no such file"):
        type(one).load(tmp_path / "nowhere.json")


def test_a_file_of_an_older_version_is_refused_with_working_advice_on_its_model(tmp_path: Path) -> None:
    path, learner = tmp_path / "learner.json", fresh("continuous", "box_active_set")
    learner.save(path)
    content = json.loads(path.read_text())
    for older, said in (
        (
            json.dumps({**content, "version": 6}),
            r"version 6 is not 9, the one this program reads; save a learner's model, its field "
            r"state\.compensator\.model, as a file",
        ),
        ("PK\x05\x06" + "\0" * 18, "is an archive, as the files of banks were until version 6, not JSON of version 9"),
    ):
        path.write_text(older)
        with pytest.raises(ModelError, match=said):
            SelfLearningCompensator.load(path)
    (tmp_path / "model.json").write_text(json.dumps(content["state"]["compensator"]["model"]))
    np.testing.assert_array_equal(
        HysteresisCreepModel.load(tmp_path / "model.json").all_weights, learner.model.all_weights
    )


LADDER = 'its ladder goes from {"tolerance": 0.001} to {"tolerance": 1e-13}'
ACCELERATED, STEPPED = "accelerated_projection", "projected_difference"
CORE, OPTIONS = ("state", "learning", "core"), ("settings", "solver_options")
ANOTHER_CORE = "the state of the core is that of another structure"


# 1e-6 is written 1e-06
@pytest.mark.parametrize(
    ("make", "names", "value", "sentence"),
    [
        *(
            (
                partial(fresh, solver=ACCELERATED),
                OPTIONS,
                {"setting": setting},
                f"{ACCELERATED} has no setting {setting!r}; {LADDER}",
            )
            for setting in (99, 0.5, [], "x", '{"tolerance": 0.5}', '{"tolerance": 1e-6}')
        ),
        (partial(fresh, solver=ACCELERATED), OPTIONS, {"lane": "none"}, "'none' is not a valid Lane"),
        *(
            (
                partial(fresh, solver="daqp"),
                OPTIONS,
                {"lane": "direct", name: value},
                f"the solver's option {name} is no number, and a file sets only numbers",
            )
            for name, value in (("log_file", "/tmp/log"), ("options", {"dump_dir": "."}), ("files", ["a"]))
        ),
        *(
            (partial(fresh, solver=STEPPED), OPTIONS, {name: value}, f"{STEPPED}: {name} must be ")
            for name, value in (
                ("steps", None),
                ("steps", 1e300),
                ("steps", 2**70),
                ("step_ratio", []),
                ("tolerance", {}),
            )
        ),
        *(
            (fresh, CORE, core, ANOTHER_CORE)
            for core in (
                np.zeros(3),
                fresh().get_state()["learning"]["core"][:-8],
                learner_for(sensor(), n=6).get_state()["learning"]["core"],
            )
        ),
        *(
            (
                a_bank,
                ("settings", "learning", name),
                1e300,
                f"{name} must be a positive number of seconds up to 1e+09, not 1e+300",
            )
            for name in ("forgetting_time_s", "hand_over_s", "reset_s", "blend_time_s")
        ),
        (
            a_bank,
            ("settings", "learning", "forgetting_time_s"),
            0.0,
            "forgetting_time_s must be a positive number of s",
        ),
        (a_bank, ("settings", "learning", "forgetting_time_s"), "x", "the field 'learning.forgetting_time_s' is wrong"),
        (a_bank, ("settings", "learning", "speed"), 1, "there is no field 'learning.speed'"),
        (
            a_bank,
            ("state", "dynamics"),
            [{"dynamics": None, "left_out": None, "sensor_delay_s": 0.0, "speed": 1}] * 13,
            "there is no field 'dynamics.0.speed'",
        ),
        (a_bank, ("state", "core"), np.zeros(2**20, np.uint8), ANOTHER_CORE),
        (a_bank, ("state", "core"), np.zeros(3), "slots must be different whole numbers from 0 to 7"),
        *(
            (a_bank, ("state", "slots"), slots, "slots must be different whole numbers from 0 to 15")
            for slots in (np.arange(13) + 4, np.zeros(13, np.int64), np.linspace(0.0, 12.0, 13))
        ),
    ],
)
def test_a_file_with_anything_wrong_in_it_is_refused_in_one_sentence_before_anything_runs(
    make: Callable[[], Any], names: tuple[str, ...], value: Any, sentence: str, tmp_path: Path
) -> None:
    path, one = tmp_path / "learner.json", make()
    one.save(path)
    settings, state = read_learner(path)
    reduce(dict.__getitem__, names[:-1], {"settings": settings, "state": state})[names[-1]] = value
    write_learner(path, settings, state)
    with pytest.raises(ModelError, match=rf"^[^\n]*learner\.json: [^\n]*{re.escape(sentence)}[^\n]*$"):
        type(one).load(path)


# Accuracy


@pytest.mark.parametrize(
    ("plant", "ratio"), [("dense_prandtl_ishlinskii", 1 / 50), ("relay_preisach", 1 / 20), ("bouc_wen", 1 / 9)]
)
@pytest.mark.parametrize("mode", MODES)
def test_three_cycles_remove_most_of_the_error_of_the_best_straight_line(plant: str, ratio: float, mode: str) -> None:
    one, learner, y_ref = at_work(24.0, mode, plant=plant)
    error = error_of(learner, y_ref, one.run, one, slice(-4000, None))
    assert error < ratio * straight_lines(sensor(plant, noise_um=0.0), y_ref[:8000])[1]


@pytest.mark.parametrize("mode", MODES)
def test_without_a_constant_in_the_structure_one_is_learned_and_pays(mode: str) -> None:
    errors = {}
    for estimate_offset in (True, False):
        one, learner, y_ref = at_work(16.0, mode, offset=False, estimate_offset=estimate_offset)
        errors[estimate_offset] = error_of(learner, y_ref, one.run, one, slice(-4000, None))
        assert learner.structure.offset is estimate_offset
    assert errors[True] < 0.1 * errors[False]


@pytest.mark.parametrize("mode", MODES)
def test_a_large_model_comes_near_to_the_noise_of_the_sensor(mode: str) -> None:
    one, learner, y_ref = at_work(30.0, mode, n=20, m=7, build_s=6.0)
    assert error_of(learner, y_ref, one.run, one, slice(-6000, None)) < 1.3 * 100.0 * NOISE


# Faults


@pytest.mark.sample(1)
@pytest.mark.parametrize(("mode", "integral_gain"), [("continuous", 0.3 / T), ("cyclic", 0.0), ("continuous", 0.0)])
def test_tens_of_thousands_of_samples_of_every_fault_never_get_through_to_the_drive_and_are_forgotten(
    mode: str, integral_gain: float
) -> None:
    plant, learner, clean = at_work(20.0, mode, rate_limit=RATE_LIMIT, integral_gain=integral_gain)
    (low, high), faulty = plant.x_range, FaultySensor(plant, seed=5)
    faulty.failing = False
    before = error_of(learner, clean, faulty, plant, slice(-6000, None))
    faulty.failing = True
    for part in range(5 if ALL else 2):
        x = learner.run(spoiled(steps(plant, 20.0), *plant.y_range, seed=part), faulty)[0]
        assert np.all((x >= low) & (x <= high))
        assert np.max(np.abs(np.diff(x))) <= RATE_LIMIT * T * (1 + 1e-12)
    assert min(learner.counts[name] for name in ("missing", "refused", "jumped")) > 200
    faulty.failing = False
    assert error_of(learner, clean, faulty, plant, slice(-6000, None)) < 1.2 * before


@pytest.mark.parametrize("mode", MODES)
def test_a_sensor_that_is_dead_for_good_leaves_the_last_good_weights_at_work(mode: str) -> None:
    plant, learner, y_ref = at_work(12.0, mode)
    before, hand_overs = error_of(learner, y_ref, plant.run, plant, slice(-3000, None)), learner.counts["hand_overs"]
    truth: list[np.ndarray] = []

    def dead(x: np.ndarray) -> np.ndarray:
        truth.append(plant.run(x))
        return np.full_like(x, np.nan)

    learner.run(y_ref, dead)
    assert learner.counts["hand_overs"] == hand_overs
    assert rms_percent(np.concatenate(truth)[-3000:], y_ref[-3000:], plant) < 3.0 * before


def test_missing_samples_only_make_the_phases_longer() -> None:
    plant, learner, y_ref = at_work(3.5, build_s=2.0, solve_delay_samples=200)

    def gappy(x: np.ndarray) -> np.ndarray:
        return np.where((learner.samples + np.arange(x.size)) % 3 == 0, np.nan, plant.run(x))

    learner.run(y_ref, gappy)
    assert learner.counts["hand_overs"] == 1
    assert learner.log[0].sample == pytest.approx(1.5 * 2100 + 200, abs=20)  # 2.1 s of good samples, then learning
    assert learner.log[0].learning_since == learner.log[0].sample - 200


# New weights


def test_new_weights_from_a_drive_that_hardly_moves_are_refused() -> None:
    plant = sensor()
    learner = learner_for(plant, build_s=1.0)
    learner.run(np.r_[np.linspace(-20.0, 0.0, 300), np.zeros(3000)], plant.run)
    assert learner.counts["hand_overs"] <= 1
    assert "of its range only, and 2 % are needed" in learner.log[-1].message


def fails(answer: np.ndarray) -> np.ndarray:
    raise RuntimeError("no luck today")


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda answer: np.full_like(answer, np.nan), "found no finite weights"),
        (fails, "failed: no luck today"),
        (lambda answer: np.full_like(answer, 3.0), "refused: "),
    ],
)
def test_without_an_answer_or_with_one_that_explains_its_own_data_worse_than_the_old_one_nothing_changes(
    monkeypatch: pytest.MonkeyPatch, spoil: Callable[[np.ndarray], np.ndarray], sentence: str
) -> None:
    right = BoxActiveSet.solve
    monkeypatch.setattr(BoxActiveSet, "solve", lambda *given, **start: spoil(right(*given, **start)))
    plant, learner, y_ref = at_work(3.0, build_s=2.0)
    weights = learner.model.weights
    x = learner.run(y_ref, plant.run)[0]
    last = learner.log[-1]
    assert np.all(np.isfinite(x))
    assert learner.counts["hand_overs"] == 0
    assert sentence in f"{last.what}: {last.message}"
    assert not last.error_new <= last.error_old
    np.testing.assert_array_equal(learner.model.weights, weights)


PROGRAM = Problem(np.eye(2), np.array([-1.0, 1.0]), lb=np.zeros(2))


class Eager(BoxActiveSet):
    """A solver that computes its answer in the setup."""

    def setup(self, problem: Problem) -> None:
        super().setup(problem)
        self.answer = super().solve()

    def solve(self, warm_start: np.ndarray | None = None) -> np.ndarray:
        return self.answer


def test_a_solver_has_not_seen_the_data_when_it_is_set_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Entry, "load", lambda entry: Eager)
    assert not np.allclose(solved("box_active_set", {"lane": "kernel"}, PROGRAM, np.zeros(2)), [1.0, 0.0])


def test_an_answer_that_its_solver_does_not_call_found_is_not_learned() -> None:
    assert np.isnan(solved("clarabel", {"max_iter": 1}, PROGRAM, np.zeros(2))).all()


def test_a_wrong_cycle_is_forgotten_in_the_next_but_one() -> None:
    plant, learner, y_ref = at_work(36.8)
    before = error_of(learner, y_ref, plant.run, plant, slice(-4000, None))
    learner.run(y_ref[: learner.samples_until_change() + 1], lambda x: 1.1 * plant.run(x))
    assert error_of(learner, y_ref, plant.run, plant, slice(9400, 13000)) < 1.2 * before


def test_a_narrow_cycle_does_not_spoil_the_weights_learned_in_a_wide_one() -> None:
    plant, learner, wide = at_work(12.0)
    learner.run(wide, plant.run)
    assert error_of(learner, 5.0 + 0.1 * steps(plant, 60.0), plant.run, plant, slice(-3000, None)) < 0.2
    assert error_of(learner, wide, plant.run, plant, slice(500, 3000)) < 3.0
