"""The structure, the operators and the model: simulation, states, copies and files."""

import copy
import json
import pickle
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from known_models import structure
from random_models import Case, cases, drive, model_of, structure_of

from piezo_model import (
    Compensator,
    HysteresisCreepModel,
    ModelError,
    ModelStructure,
    OperatorState,
    identify,
)
from piezo_model.atomic_file import write_text
from piezo_model.json_file import decoded
from piezo_model.operators import creep, creep_gain, dead_zone, play

# Simulation.


@given(cases())
def test_a_drive_in_chunks_gives_the_same_bits_as_the_whole(case: Case) -> None:
    x = case.a_drive(80)
    whole, end = case.model.advance(x, case.state)
    parts, state = [], case.state
    for part in np.split(x, np.sort(case.rng.integers(0, 80, 4))):
        y, state = case.model.advance(part, state)
        parts.append(y)
    np.testing.assert_equal(vars(state), vars(end))
    np.testing.assert_array_equal([np.concatenate(parts), case.model.simulate(x, case.state)], [whole, whole])


def test_without_states_the_actuator_had_rested_where_a_compensators_drive_starts() -> None:
    rng = np.random.default_rng(0)
    model = model_of(rng, structure_of(rng, 4, 2, 3, 2, True))
    x = model.structure.x_centre + drive(rng, 50)
    np.testing.assert_array_equal(model.simulate(x), model.simulate(x, Compensator(model).state))


@cache
def identified() -> tuple[HysteresisCreepModel, np.ndarray, np.ndarray]:
    """A model, and the recording of an actuator that came from above, which it was identified from."""
    s = ModelStructure.equidistant(3, 1, (0.0, 100.0), (-10.0, 10.0), (10.0,), 1e-3, offset=True)
    truth = HysteresisCreepModel.from_weights(s, [0.3, 0.2, 0.1, 0.05, 1.5, 0.02, 0.05, 0.04, 0.03, 0.02, 0.01])
    x = 50.0 + 45.0 * np.sin(np.arange(6000) / 150) * np.linspace(0.5, 1.0, 6000)
    y = truth.simulate(x, OperatorState.settled_at(s, 50.0, "above"))
    return identify(x, y + 0.01 * np.random.default_rng(0).normal(size=x.size), s), x, y


def test_an_array_is_simulated_from_the_start_that_was_identified_and_any_number_of_times() -> None:
    model, x, y = identified()
    before, starts = model.to_dict(), (None, model.start, model.start, model.initial_state("rest"))
    *errors, rested = (float(np.sqrt(np.mean((model.simulate(x, start) - y) ** 2))) for start in starts)
    assert errors == [errors[0]] * 3
    assert errors[0] < model.report["fit"]["rms"] * 1.1
    assert rested > 5.0 * errors[0]
    assert model.to_dict() == before


@pytest.mark.parametrize(
    "way", [lambda it: it, copy.copy, copy.deepcopy, lambda it: pickle.loads(pickle.dumps(it)), replace]
)
def test_nothing_of_a_model_can_be_changed_in_place_nor_of_a_copy_of_it(
    way: Callable[[HysteresisCreepModel], HysteresisCreepModel],
) -> None:
    model = way(identified()[0])
    s, before = model.structure, model.to_dict()
    arrays = (model.w_H, model.w_S_inverse, model.w_K, model.slopes, model.start.play, model.start.creep)
    for array in (*arrays, s.thresholds, s.slope_map, s.inverse_slope_map, s.straight_line):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 7.0
    for change in (
        lambda report: report.update(fit=None),
        lambda report: report.pop("fit"),
        lambda report: report["fit"].clear(),
        lambda report: report["fit"].__setitem__("rms", 0.0),
        lambda report: report.__ior__({"lag": 0}),
    ):
        with pytest.raises(TypeError, match="read-only"):
            change(model.report)
    assert model.to_dict() == before
    assert json.loads(json.dumps(before)) == json.loads(json.dumps(identified()[0].to_dict()))


def test_a_model_keeps_nothing_of_what_it_was_made_from(model: HysteresisCreepModel) -> None:
    fit, sentences, start = {"rms": 1.0}, ["one"], OperatorState.settled_at(model.structure, 0.3)
    made = replace(model, report={"fit": fit, "sentences": sentences}, start=start)
    before = made.to_dict()
    fit["rms"], start.play[:] = 2.0, 9.0
    sentences.append("two")
    assert made.to_dict() == before


@pytest.fixture
def model() -> HysteresisCreepModel:
    rng = np.random.default_rng(7)
    return model_of(rng, structure_of(rng, 5, 3, 2, 3, True))


@pytest.mark.parametrize("x", [-10.0, 0.0, 20.0, 50.0, 100.0])
@pytest.mark.parametrize(("came_from", "before"), [("above", 800.0), ("below", -800.0)])
def test_the_settled_states_are_those_after_a_long_time_at_the_input(
    x: float, came_from: Literal["above", "below"], before: float
) -> None:
    s = ModelStructure.equidistant(3, 1, (0.0, 100.0), (-1.0, 1.0), (100.0, 10.0), 1e-3)
    model = HysteresisCreepModel.from_weights(s, s.straight_line)
    held = model.advance(np.repeat([before, x], 10_000), OperatorState.settled_at(s, 50.0))[1]
    settled = OperatorState.settled_at(s, x, came_from)
    np.testing.assert_allclose(np.r_[settled.play, settled.creep], np.r_[held.play, held.creep], atol=1e-12)


@pytest.mark.parametrize("x", [-10.0, 0.0, 20.0, 50.0, 100.0])
def test_the_states_of_no_known_direction_are_those_after_swings_through_the_range_that_died_away(x: float) -> None:
    s = ModelStructure.equidistant(3, 1, (0.0, 100.0), (-1.0, 1.0), (1e3,), 1e-3)
    model, swings = (
        HysteresisCreepModel.from_weights(s, s.straight_line),
        np.outer(0.999 ** np.arange(20_000), (100.0 - x, 0.0 - x)),
    )
    swung = model.advance([*(x + swings.ravel()), x], OperatorState.settled_at(s, 50.0))[1]
    np.testing.assert_allclose(OperatorState.settled_at(s, x).play, swung.play, atol=2e-3)


@pytest.mark.parametrize("rate_Hz", [100, 1000, 8000])
def test_a_second_after_a_step_creep_has_its_closed_form_at_every_sampling_rate(rate_Hz: int) -> None:
    s = ModelStructure.equidistant(3, 1, (-100.0, 100.0), (-1.0, 1.0), (10.0, 1.0), 5e-3)
    weights = [0.1, 0.1, 0.1, 0.1, 1.0, 0.1, 0.3, 0.2, 0.1, 0.1]
    start = OperatorState.settled_at(s, 0.0)
    model = replace(HysteresisCreepModel.from_weights(s, weights), start=start, sensor_delay_s=0.01)
    same, r = model.at(1.0 / rate_Hz), s.thresholds
    state = same.advance(np.full(rate_Hz, 80.0), model.initial_state())[1]
    expected = np.outer(1.0 - np.exp(-np.array(s.creep_rates)), np.maximum(0.8 - r, 0.0))
    np.testing.assert_allclose(state.creep.reshape(2, -1)[:, : r.size], expected, atol=1e-12)
    np.testing.assert_allclose(state.play[: r.size], 0.8 - r, atol=1e-12)
    np.testing.assert_equal((same.weights, same.initial_state().creep), (model.weights, start.creep))
    assert (same.report["sample_time_s"], same.sensor_delay_s) == (5e-3, 0.01)


def test_a_model_is_itself_at_its_own_rate(model: HysteresisCreepModel) -> None:
    own = model.structure.sample_time
    assert model.at(own) is model.at(own * (1.0 + 1e-9)) is model


def test_a_sample_that_is_not_a_number_moves_no_state(model: HysteresisCreepModel) -> None:
    before = model.advance([0.1, 0.7], OperatorState.settled_at(model.structure, 0.3))[1]
    y, state = model.advance([np.nan], before)
    assert np.all(np.isfinite(y))
    np.testing.assert_equal(vars(state), vars(before))


# Files.


@settings(max_examples=30)
@given(case=cases())
def test_a_saved_model_is_loaded_bit_for_bit_with_its_report(
    tmp_path_factory: pytest.TempPathFactory, case: Case
) -> None:
    folder, x = tmp_path_factory.mktemp("models"), drive(case.rng, 20)
    replace(case.model, report={"note": "Prüfstand"}).save(folder / "a.json")
    loaded = HysteresisCreepModel.load(folder / "a.json")
    assert (loaded.structure, loaded.report["note"]) == (case.structure, "Prüfstand")
    np.testing.assert_equal(*((model.all_weights, model.simulate(x)) for model in (loaded, case.model)))
    loaded.save(folder / "b.json")
    assert (folder / "a.json").read_bytes() == (folder / "b.json").read_bytes()


def spoil(change: Callable[[dict[str, Any]], Any]) -> Callable[[str], str]:
    def apply(text: str) -> str:
        data = json.loads(text)
        change(data)
        return json.dumps(data)

    return apply


@pytest.mark.parametrize(
    ("spoiled", "sentence"),
    [
        (lambda text: text[: len(text) // 2], "is not a whole JSON file"),
        (lambda text: "", "is not a whole JSON file"),
        (lambda text: "[1, 2]", "the format field is not 'piezobench-model'"),
        (lambda text: '{"format": "GeoJSON"}', "the format field is not 'piezobench-model'"),
        (spoil(lambda data: data.update(version=99)), "version 99 is not 3, the one this program reads"),
        (
            spoil(lambda data: data.update(version=2)),
            "is not 3, the one this program reads; identify again from the recording",
        ),
        (spoil(lambda data: data.pop("w_K")), "the field 'w_K' is missing"),
        (spoil(lambda data: data.pop("structure")), "the field 'structure' is missing"),
        (spoil(lambda data: data["structure"].pop("x_scale")), "the field 'structure.x_scale' is missing"),
        (spoil(lambda data: data["structure"].update(colour="red")), "there is no field 'structure.colour'"),
        (
            spoil(lambda data: data["structure"].update(offset=1)),
            "the field 'structure.offset' is wrong: expected `bool`, got `int`",
        ),
        (
            spoil(lambda data: data["structure"].update(play_thresholds=[0.1, "b"])),
            r"the field 'structure.play_thresholds\[1\]' is wrong: expected `float`, got `str`",
        ),
        (
            spoil(lambda data: data["structure"].update(input_unit=3)),
            "the field 'structure.input_unit' is wrong: expected `str`, got `int`",
        ),
        (spoil(lambda data: data.update(structure=3)), "the field 'structure' is wrong: expected `object`, got `int`"),
        (spoil(lambda data: data.update(report=[])), "the field 'report' is wrong: expected `object`, got `array`"),
        (spoil(lambda data: data.update(w_H="big")), "the field 'w_H' is wrong: expected `array`, got `str`"),
        (
            spoil(lambda data: data["w_H"].__setitem__(1, True)),
            r"the field 'w_H\[1\]' is wrong: expected `float`, got "
            r"`bool`",
        ),
        (spoil(lambda data: data.update(offset=None)), "the field 'offset' is wrong: expected `float`, got `null`"),
        (
            spoil(lambda data: data["structure"].update(sample_time="1 ms")),
            "the field 'structure.sample_time' is wrong: expected `float`, got `str`",
        ),
        (spoil(lambda data: data["w_H"].append(0.1)), r"w_H must have 6 values for this structure, not shape \(7,\)"),
        (
            spoil(lambda data: data["w_S_inverse"].pop()),
            r"w_S_inverse must have 6 values for this structure, not shape "
            r"\(5,\)",
        ),
        (spoil(lambda data: data["w_K"].__setitem__(2, np.nan)), "is not a whole JSON file"),
        (spoil(lambda data: data.update(offset=np.inf)), "is not a whole JSON file"),
        (spoil(lambda data: data["structure"].update(y_scale=np.nan)), "is not a whole JSON file"),
        (spoil(lambda data: data["w_K"].__setitem__(0, 10**400)), "out of range"),
        (spoil(lambda data: data["w_H"].__setitem__(3, -0.1)), r"w_H\[3\] must not be negative, not -0.1"),
        (spoil(lambda data: data["w_K"].__setitem__(0, -1e-9)), r"w_K\[0\] must not be negative, not -1e-09"),
        (spoil(lambda data: data["w_H"].__setitem__(0, 0)), r"w_H\[0\] must be positive"),
        (
            spoil(lambda data: data["w_S_inverse"].__setitem__(5, -9.0)),
            r"the slope of S⁻¹ beyond threshold .* must be "
            r"positive",
        ),
        (
            spoil(lambda data: data["structure"].update(offset=False)),
            "the structure has no offset, and the model has one of",
        ),
        (
            spoil(lambda data: data["structure"].update(play_thresholds=[0.1, 0.3, 0.2, 0.4, 0.5])),
            "positive and ascending",
        ),
    ],
)
def test_a_spoiled_file_is_refused_with_one_sentence_that_names_it(
    model: HysteresisCreepModel, tmp_path: Path, spoiled: Callable[[str], str], sentence: str
) -> None:
    path = tmp_path / "stage_3.json"
    model.save(path)
    path.write_text(spoiled(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(ModelError, match=rf"^{re.escape(str(path))}: .*{sentence}[^\n]*\Z"):
        HysteresisCreepModel.load(path)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("absent.json", "no such file"), ("", "cannot be read"), ("binary.json", "is not a whole JSON")],
)
def test_a_file_that_is_absent_a_folder_or_binary_is_refused_by_its_name(
    tmp_path: Path, name: str, sentence: str
) -> None:
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ModelError, match=f"{re.escape(str(tmp_path / name))}: {sentence}"):
        HysteresisCreepModel.load(tmp_path / name)


@pytest.mark.parametrize("note", [np.inf, "\ud800"])  # the second fails with the temporary file open already
def test_a_failing_save_leaves_the_old_file_whole_and_nothing_beside_it(
    model: HysteresisCreepModel, tmp_path: Path, note: object
) -> None:
    model.save(tmp_path / "m.json")
    old = (tmp_path / "m.json").read_bytes()
    with pytest.raises(ValueError, match=r"not JSON compliant|surrogates not allowed"):
        write_text(tmp_path / "m.json", json.dumps({"note": note}, ensure_ascii=False, allow_nan=False))
    assert (tmp_path / "m.json").read_bytes() == old
    assert [file.name for file in tmp_path.iterdir()] == ["m.json"]


@pytest.mark.parametrize(("low", "high"), [(-20.0, 20.0), (3.0, 7.0)])
def test_a_descending_output_range_gives_the_structure_of_the_reversed_output(low: float, high: float) -> None:
    descending, ascending = structure(y_range=(high, low)), structure(y_range=(low, high))
    assert descending == ascending.reversed_output()
    assert (descending.negative_gain, ascending.negative_gain) == (True, False)
    np.testing.assert_allclose(descending.unit_output(np.array([high, low])), [-1.0, 1.0])


NUMPYS = structure(sample_time=np.float32(0.5), creep_rates=np.array([2, 1]), offset=np.True_)
FIGURES: dict[str, tuple[Callable[[], Any], Any]] = {
    "creep weights do not grow with the rates and go without them": (
        lambda: [structure(creep_rates=rates, offset=False).d for rates in ((), (1.0,), (100.0, 10.0, 1.0, 0.1))],
        [6, 10, 10],
    ),
    "the last weight is the offset": (lambda: structure(offset=True).weight_names[-1], "offset"),
    "the range of the input becomes the unit interval": (
        lambda: structure(x_range=(0.0, 150.0)).unit_input(np.array([0.0, 75.0, 150.0])).tolist(),
        [-1.0, 0.0, 1.0],
    ),
    "bounds of weights, slopes and the offset": (
        lambda: structure(n=1, m=1, offset=True).lower_bounds(0.01).tolist(),
        [0.0, 0.01, 0.01, 0.01, 0.0, 0.0, -np.inf],
    ),
    "numbers of NumPy survive JSON": (lambda: decoded(json.dumps(NUMPYS.to_dict()), ModelStructure), NUMPYS),
    "very slow creep loses no digits": (
        lambda: creep_gain([1e-9], 1e-6).tolist(),
        [pytest.approx(1e-15, rel=1e-14, abs=0.0)],
    ),
    "a play stays where it is at a sample that is no number": (lambda: play([np.nan], [0.1], [0.3])[1].tolist(), [0.3]),
    "so does creep": (lambda: creep([np.nan], [0.1], [1.0], 1e-3, [0.3])[1].tolist(), [0.3]),
    "so do dead zones": (lambda: dead_zone([np.nan], [-0.5, 0.0, 0.5]).tolist(), [[0.0, 0.0, 0.0]]),
}


@pytest.mark.parametrize("what", FIGURES)
def test_figures_of_structures_and_operators_are_those_computed_by_hand(what: str) -> None:
    compute, expected = FIGURES[what]
    assert compute() == expected
