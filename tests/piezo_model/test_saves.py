"""Whatever is saved can be loaded; what a file cannot hold is refused first, by its name, and the file stays."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_loops import MODES, T, structure_for

from piezo_model import CompensatorBank, HysteresisCreepModel, OperatorState, SelfLearningCompensator, plants
from piezo_model.deployment import Deployment

PLANT = plants.get("relay_preisach", sample_time=T)
STRUCTURE = structure_for(PLANT)
MODEL = HysteresisCreepModel.from_weights(STRUCTURE, STRUCTURE.straight_line)
STATES = OperatorState.settled_at(STRUCTURE, 75.0)


def learner(**options: Any) -> SelfLearningCompensator:
    return SelfLearningCompensator(STRUCTURE, **options)


def bank(**options: Any) -> CompensatorBank:
    return CompensatorBank(STRUCTURE, 2, **options)


def model(**changes: Any) -> HysteresisCreepModel:
    return replace(MODEL, **changes)


def deployment(**changes: Any) -> Deployment:
    usual = {"solver": "box_active_set", "lane": "kernel", "tier": "mid", "settings": {}, "mode": "cyclic"}
    return Deployment(**{"model": MODEL, "x_limits": (0.0, 150.0), **usual, **changes})


FOUND: list[tuple[Callable[..., Any], dict[str, Any]]] = [
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
    (deployment, {"x_limits": np.array([0, 150])}),
    (deployment, {"evidence": {"rms": np.float32(0.1), "curve": np.arange(3), "gap": np.inf}}),
]


@pytest.mark.parametrize(("make", "options"), FOUND)
def test_numbers_of_numpy_are_saved_and_loaded(
    make: Callable[..., Any], options: dict[str, Any], tmp_path: Path
) -> None:
    one = make(**options)
    one.save(tmp_path / "file")
    other = type(one).load(tmp_path / "file")
    other.save(tmp_path / "again")
    if make is not bank:
        assert (tmp_path / "again").read_text() == (tmp_path / "file").read_text()
    else:
        np.testing.assert_equal(other.get_state(), one.get_state())
        assert other.options == one.options


def test_arrays_and_infinite_numbers_of_a_report_return_as_they_were(tmp_path: Path) -> None:
    report = {"curve": np.arange(3.0), "gap": -np.inf, "lag": np.nan}
    model(report=report).save(tmp_path / "model.json")
    np.testing.assert_equal(dict(HysteresisCreepModel.load(tmp_path / "model.json").report), report)


REFUSED: list[tuple[Callable[..., Any], dict[str, Any], str]] = [
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
    (learner, {"mode": "continuous", "solver_options": {"hook": print}}, "solver_options.hook is a builtin_function"),
    (bank, {"x_limits": (-np.inf, np.inf)}, r"x_limits\[0\] must be two numbers in ascending order, both finite"),
    (bank, {"rate_limit": np.inf}, "rate_limit must be above 0"),
    (bank, {"learn": "no"}, "learn must be True or False"),
    (model, {"report": {"fit": {"hook": print}}}, "report.fit.hook is a builtin_function_or_method, which a file"),
    (model, {"report": {"names": {"a", "b"}}}, "report.names is a set, which a file cannot hold"),
    (model, {"report": {"z": np.array([1j])}}, "report.z is a ndarray, which a file cannot hold"),
    (model, {"w_H": 1e150 * MODEL.w_H}, r"w_H\[0\] is not a finite number"),
    (model, {"offset": 1e200}, "offset must be above"),
    (model, {"start": OperatorState(np.full(8, np.nan), STATES.creep)}, r"play\[0\] is not a finite number"),
    (deployment, {"x_limits": (-np.inf, np.inf)}, "x_limits must be two finite numbers in ascending order"),
    (deployment, {"x_limits": (5.0, 1.0)}, "x_limits must be two finite numbers in ascending order"),
    (deployment, {"tier": "best"}, "tier must be one of default, low, mid, high, exact"),
    (deployment, {"solver": "nobody"}, "there is no solver 'nobody'"),
    (deployment, {"evidence": {"run": object()}}, "evidence.run is a object, which a file cannot hold"),
]


@pytest.mark.parametrize(("make", "options", "sentence"), REFUSED)
def test_what_a_file_cannot_hold_is_refused_by_its_name_and_the_file_stays(
    make: Callable[..., Any], options: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("an older file")
    with pytest.raises(ValueError, match=sentence) as refused:
        make(**options).save(tmp_path / "file")
    assert "\n" not in str(refused.value)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("file", "an older file")]
