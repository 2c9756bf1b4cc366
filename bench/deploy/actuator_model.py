"""The model of the controller: from the recording of the race, from a file, or from a problem of the run.

A race on a recording stores the model that `identify` makes of all of it, with the error on the last fifth of the one
that it makes of the rest. Any other model is validated on that fifth, too, and refused if its error is more than 1.1
times as large. A model that was fitted to that fifth has an advantage there, so its refusal is fair, and its acceptance
no evidence.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from bench import problems
from bench.problems.recorded import FITTED, HELD_OUT, Recorded, held_out_recording
from bench.races.metrics import relative_gap
from bench.store import Run, RunError
from piezo_model import HysteresisCreepModel
from piezo_model.checks import check

WORSE = 1.1
"""Largest ratio of another model's error to that of the model of the first four fifths."""
REFITTED, UNKNOWN = "held out, then fitted", "not known"
SENTENCES = {
    REFITTED: "Fitted to the first four fifths alone, its RMS error is {:.3g} % of the range on the last, which was "
    "held out.",
    HELD_OUT: "On the last fifth of the recording, which was held out, its RMS error is {:.3g} % of the range.",
    FITTED: "On the last fifth of the recording, to which it was fitted, its RMS error is {:.3g} % of the range.",
    UNKNOWN: "On the last fifth of the recording its RMS error is {:.3g} % of the range; whether it was fitted to it "
    "is not known.",
}
"""Meaning of the error, by the role of the last fifth."""


@dataclass(frozen=True)
class ChosenModel:
    """A model and its source."""

    model: HysteresisCreepModel
    source: str
    certificate: Mapping[str, Any] = field(default_factory=dict)
    error_percent: float | None = None
    """RMS error on the last fifth of the recording, % of the range; None if the race was not on a recording."""
    last_fifth: str = ""
    """What the last fifth is to the model, of ``SENTENCES``; "" if the race was not on a recording."""

    @property
    def sentence(self) -> str:
        """What is known of the model: its error, and what it says of creep; "" if nothing is."""
        error = SENTENCES.get(self.last_fifth, "").format(self.error_percent)
        return f"{error} {self.model.report.get('creep', {}).get('sentence', '')}".strip()

    def evidence(self) -> dict[str, Any]:
        """Evidence for the file of the decision."""
        return {
            "model_from": self.source,
            "certificate": dict(self.certificate),
            **({"error_percent": self.error_percent, "last_fifth": self.last_fifth} if self.last_fifth else {}),
        }


def model_for(
    run: Run,
    model: HysteresisCreepModel | None = None,
    problem: str | None = None,
    simulated: bool = False,
    source: str = "the model file",
) -> ChosenModel:
    """The given model, that of the problem "set/name", or the one that the run stores of its recording.

    ``simulated`` permits the model of a simulated actuator, which is not validated. RunError if there is no model or it
    is worse than the stored one.
    """
    if model is not None:
        return _validated(run, ChosenModel(model, source, dict(model.report.get("certificate") or {})))
    if problem is None and not simulated and Recorded.name in run.settings.get("models", {}):
        return _stored(run)
    key = _find_problem(run, problem, simulated)
    chosen = _of_problem(run, key)
    return chosen if _is_simulated(key) else _validated(run, chosen)


def _stored(run: Run) -> ChosenModel:
    """The model that the run stores of its recording."""
    note = run.settings["models"][Recorded.name]
    check(
        "error_percent" in note,
        f"{run.path} keeps no model of its recording, since identify refused it "
        f"({note.get('refused', 'no reason is given')}); give a model with --model, or name a problem with --problem",
        RunError,
    )
    model = HysteresisCreepModel.load(run.model_path(Recorded.name))
    return ChosenModel(
        model,
        "the recording of the race",
        dict(model.report["certificate"] or {}),
        note["error_percent"],
        REFITTED,
    )


def _validated(run: Run, chosen: ChosenModel) -> ChosenModel:
    """The model with its error on the last fifth of the recording; RunError if that of a model of the rest is much
    smaller."""
    names = run.settings.get("problems", {}).get(Recorded.name, ())
    if not names:
        return chosen
    error = chosen.model.validate(held_out_recording(run.problem(Recorded.name, names[0]))).fit.rms_percent
    note = run.settings.get("models", {}).get(Recorded.name, {"digests": {}})
    known = note.get("error_percent")
    if known is not None and error > WORSE * known:
        raise RunError(
            f"{run.path}: the model from {chosen.source} has an RMS error of {error:.3g} % of the range on the last "
            f"fifth of the recording, and one of the first four fifths {known:.3g} %; leave out --model and --problem "
            "to take the run's"
        )
    of_fitted, fitted = (
        chosen.certificate.get("problem_of_run", "").startswith(f"{Recorded.name}/"),
        chosen.model.fitted,
    )
    kinds = (
        [HELD_OUT]
        if of_fitted
        else [note["digests"].get(digest, UNKNOWN) for digest in (fitted.digests if fitted else ())]
    )
    last_fifth = min(kinds, key=(FITTED, UNKNOWN, HELD_OUT).index, default=UNKNOWN)  # the worst of its recordings
    return replace(chosen, error_percent=error, last_fifth=last_fifth)


def _find_problem(run: Run, problem: str | None, simulated: bool) -> tuple[str, str]:
    """Set and name of a problem "set/name"; by default of the first simulated actuator, if those are permitted."""
    raced = sorted(run.settings.get("problems", {}).items())
    keys = {f"{set_name}/{name}": (set_name, name) for set_name, names in raced for name in sorted(names)}
    if problem is None:
        problem = next((name for name, key in keys.items() if simulated and _is_simulated(key)), None)
    if problem is None:
        raise RunError(
            f"{run.path} holds no model of {'a simulated actuator' if simulated else 'your actuator'}; give one "
            "with --model, as identify "
            "writes it, name a problem with --problem, or take a simulated actuator with --simulated"
        )
    check(problem in keys, f"{run.path} has no problem {problem!r}; there are {', '.join(keys)}", RunError)
    check(
        simulated or not _is_simulated(keys[problem]),
        f"{run.path}: {problem} is a simulated actuator; give a model with --model, or --simulated to use it anyway",
        RunError,
    )
    return keys[problem]


def _is_simulated(key: tuple[str, str]) -> bool:
    return problems.find(key[0]).origin == "simulated"


def _of_problem(run: Run, key: tuple[str, str]) -> ChosenModel:
    """The model at the proven optimum of a problem."""
    problem, name = run.problem(*key), "/".join(key)
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
