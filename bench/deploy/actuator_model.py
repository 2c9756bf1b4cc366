"""The model that a controller gets: of the recording that was raced on, of a file, or of a problem of the run.

A race on a recording keeps the model that `identify` makes of the first four fifths, with its error on the last.
Another model is judged on that last fifth, too, and refused where it errs more than 1.1 times as much.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from bench import problems
from bench.derived.table import ONESHOT
from bench.problems.recorded import Recorded, kept_back
from bench.races.metrics import relative_gap
from bench.races.stream.race import KIND as STREAM_KIND
from bench.store import Run, RunError
from piezo_model import HysteresisCreepModel

WORSE = 1.1
"""Largest ratio of another model's error to that of the model that the run keeps."""
SIMULATED = "simulated"


@dataclass(frozen=True)
class ChosenModel:
    """A model and where it comes from."""

    model: HysteresisCreepModel
    source: str
    certificate: Mapping[str, Any] = field(default_factory=dict)
    error_percent: float | None = None
    """On the last fifth of the recording, which was kept back; None where the race was not on one."""

    @property
    def sentence(self) -> str:
        """Its error; "" where there is nothing to tell it by."""
        return (
            ""
            if self.error_percent is None
            else (
                f"On the last fifth of the recording, which was kept back, it errs by {self.error_percent:.3g} % of "
                "the range (RMS)."
            )
        )

    def evidence(self) -> dict[str, Any]:
        """What the file says of it."""
        return {
            "model_from": self.source,
            "certificate": dict(self.certificate),
            **({} if self.error_percent is None else {"unseen_error_percent": self.error_percent}),
        }


def model_for(
    run: Run,
    model: HysteresisCreepModel | None = None,
    problem: str | None = None,
    simulated: bool = False,
    source: str = "the model file that was given",
) -> ChosenModel:
    """The model that is given, that of the problem "set/name", or that which the run keeps of a recording;
    ``simulated`` says whether a simulated actuator will do, which is judged on no recording.

    RunError where there is none, or a worse one than the run keeps.
    """
    if model is not None:
        return _judged(run, ChosenModel(model, source, dict(model.report.get("certificate", {}))))
    if run.settings.get("race", "oneshot") == STREAM_KIND:
        raise RunError(f"{run.path}: a stream holds no model; give one with --model, as identify writes it")
    if problem is None and not simulated and Recorded.name in run.settings.get("models", {}):
        return _kept(run)
    name, key = _named(run, problem, simulated)
    found = _of_problem(run, name, key)
    return found if problems.find(key[0]).origin == SIMULATED else _judged(run, found)


def _kept(run: Run) -> ChosenModel:
    """The model that the run keeps of its recording."""
    note = run.settings["models"][Recorded.name]
    if "error_percent" not in note:
        raise RunError(
            f"{run.path} keeps no model of its recording, since identify refused it "
            f"({note.get('refused', 'no reason is given')}); "
            "give a model with --model, or name a problem with --problem"
        )
    model = HysteresisCreepModel.load(run.model_path(Recorded.name))
    return ChosenModel(
        model,
        "the first four fifths of the recording",
        dict(model.report.get("certificate", {})),
        note["error_percent"],
    )


def _judged(run: Run, found: ChosenModel) -> ChosenModel:
    """A model with its error on what was kept back of the recording; RunError where that of the model which the run
    keeps is much smaller."""
    names = run.settings.get("problems", {}).get(Recorded.name, ())
    if not names:
        return found
    unseen = kept_back(run.problem(Recorded.name, names[0]))
    error = found.model.validate(unseen).fit.rms_percent
    known = run.settings.get("models", {}).get(Recorded.name, {}).get("error_percent")
    if known is not None and error > WORSE * known:
        raise RunError(
            f"{run.path}: the model from {found.source} errs by {error:.3g} % of the range on the last "
            "fifth of the recording, and "
            f"the one that the run keeps by {known:.3g} %; leave out --model and --problem to take that one"
        )
    return ChosenModel(found.model, found.source, found.certificate, error)


def _named(run: Run, asked: str | None, simulated: bool) -> tuple[str, tuple[str, str]]:
    """The problem that is asked for, by default the first of a simulated actuator where one will do."""
    rows = run.rows(ONESHOT).drop_duplicates(["problem_set", "problem"])
    names = {f"{one}/{two}": (str(one), str(two)) for one, two in zip(rows.problem_set, rows.problem, strict=True)}
    if asked is not None and asked not in names:
        raise RunError(f"{run.path} has no problem {asked!r}; there are {', '.join(names)}")
    for name, key in names.items():
        is_simulated = problems.find(key[0]).origin == SIMULATED
        if name == asked and is_simulated and not simulated:
            raise RunError(
                f"{run.path}: {name} is a simulated actuator; give a model with --model, or --simulated to "
                "take it all the same"
            )
        if name == asked or (asked is None and simulated and is_simulated):
            return name, key
    raise RunError(
        f"{run.path} holds no model of {'a simulated actuator' if simulated else 'your actuator'}; give one "
        "with --model, as identify "
        "writes it, name a problem with --problem, or take a simulated actuator with --simulated"
    )


def _of_problem(run: Run, name: str, key: tuple[str, str]) -> ChosenModel:
    """The proven optimum of a problem."""
    problem = run.problem(*key)
    if problem.validation is None:
        raise RunError(
            f"{run.path}: the problem {name} is a program from a file and holds no model; give one with "
            "--model, as identify writes it"
        )
    form = problem.forms["scaled"]
    cost_gap, violation = relative_gap(form, np.array(form.certificate.x))
    return ChosenModel(
        HysteresisCreepModel.from_weights(problem.validation.structure, problem.optimal_weights),
        f"the problem {name}, {problems.find(key[0]).origin}",
        {"problem_of_run": name, "cost_gap": cost_gap, "violation": violation, **asdict(form.certificate)},
    )
