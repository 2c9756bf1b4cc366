"""The file of a decision: what it holds and refuses, and the compensator that starts from it."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile_files import MODEL

import solvers
from bench.deploy.deployment import Deployment
from piezo_model import ModelError

ACCELERATED, STEPPED = "accelerated_projection", "projected_difference"


def deployment(**changes: Any) -> Deployment:
    usual = {"solver": "box_active_set", "lane": "kernel", "tier": "mid", "settings": {}, "mode": "cyclic"}
    return Deployment(**{"model": MODEL, "x_limits": (1.0, 9.0), **usual, **changes})


@pytest.mark.parametrize(
    "changes",
    [
        {"x_limits": np.array([0, 150])},
        {"evidence": {"rms": np.float32(0.1), "curve": np.arange(3), "gap": np.inf}},
    ],
)
def test_numbers_of_numpy_are_saved_and_loaded(changes: dict[str, Any], tmp_path: Path) -> None:
    deployment(**changes).save(tmp_path / "c.json")
    Deployment.load(tmp_path / "c.json").save(tmp_path / "again")
    assert (tmp_path / "again").read_text() == (tmp_path / "c.json").read_text()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"x_limits": (-np.inf, np.inf)}, "x_limits must be two finite numbers in ascending order"),
        ({"x_limits": (5.0, 1.0)}, "x_limits must be two finite numbers in ascending order"),
        ({"tier": "best"}, "'best' is not a valid Tier"),
        ({"solver": "nobody"}, "there is no solver 'nobody'"),
        ({"evidence": {"run": object()}}, "evidence.run is a object, which a file cannot hold"),
        *(
            ({"solver": solver, "settings": settings}, f"{solver} has no setting ")
            for solver, settings in (
                (ACCELERATED, {"tolerance": 0.5}),
                (ACCELERATED, {"tolerance": {}}),
                (ACCELERATED, {"setting": 99}),
                (ACCELERATED, {"rung": 2}),
                (ACCELERATED, {"lane": "none"}),
                (STEPPED, {"steps": None}),
                (STEPPED, {"steps": 2**70}),
                (STEPPED, {"tolerance": {}}),
            )
        ),
    ],
    ids=str,
)
def test_what_no_compensator_or_file_can_have_is_refused_and_the_file_stays(
    changes: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    path = tmp_path / "c.json"
    path.write_text("an older file")
    with pytest.raises(ValueError, match=rf"^[^\n]*{sentence}[^\n]*$"):
        deployment(**changes).save(path)
    assert path.read_text() == "an older file"
    if "settings" in changes:  # and in a file
        solver = changes["solver"]
        deployment(solver=solver, settings=dict(solvers.get(solver).ladder(1.0)[0])).save(path)
        path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
        with pytest.raises(ModelError, match=rf"^[^\n]*c\.json: {sentence}[^\n]*; its ladder goes from [^\n]*$"):
            Deployment.load(path)


def test_a_file_whose_model_is_of_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    deployment().save(path)
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "model": {**content["model"], "version": 2}}))
    with pytest.raises(ModelError, match=r"c\.json: model: version 2 is not 3, the one this"):
        Deployment.load(path)


def test_a_compensator_starts_with_its_model_solver_and_limits_and_other_options(tmp_path: Path) -> None:
    deployment(solver=STEPPED, settings={"steps": 100}).save(tmp_path / "c.json")
    learner = Deployment.load(tmp_path / "c.json").learner(build_s=1.0)
    chosen = learner.settings
    assert (chosen.solver, chosen.x_limits, chosen.build_s) == (STEPPED, (1.0, 9.0), 1.0)
    assert learner.structure == MODEL.structure
    assert learner.step(1e9, math.nan) == 9.0
