"""Whether answers are right, judged in exact arithmetic with nothing timed: those of a solver, and those of a run.

A *solver* solves each program of a set once. An answer's error is the larger of its relative cost gap and its relative
violation (`bench.races.metrics`). A solver has two settings here: its defaults, and the finest rung of its ladder if it
has one.

The accuracy in a *run* has to follow from the answers that are stored in it. The certificates are replayed from the
data of the problems; the first answer of each row, and the worst judged timed one on the data of its draw, have to give
the stored gaps, violations and errors of the model. This shows that these follow from stored answers. It does not show
who gave the answers, nor that statuses, iterations or times are true.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.messages.task import ChildSettings, Progress, Setting, Status, Task, default_setting, settings_ladder, silent
from bench.problems.fresh import mixture
from bench.problems.protocol import RaceProblem
from bench.processes.solver_child import SolverChild
from bench.races.measuring import set_up
from bench.races.metrics import measures, relative_gap, timed_measures
from bench.races.race import PRELOAD
from bench.report.words import settings_label
from bench.store import Run
from solvers import Entry
from solvers.certificate import NotCertified

LIMITS = ChildSettings(time_limit_s=10.0, preload=PRELOAD)
"""Of one program, after which the solver's process is ended."""
ROUNDING = 1e-9
"""Largest relative difference of a timed gap, and absolute one of an error of a model, that another order of additions
made, as of BLAS in runs of before: V* + c cancels to 1e-4 of c where the fit is good. Other measures are exact."""
OF_MODELS = ("weight_error", "model_error_percent", "stage_excess", "timed_stage_excess")
FIRST = ("cost_gap", "violation", *OF_MODELS[:3])
TIMED = ("timed_gap", "timed_violation", *OF_MODELS[3:])
"""Columns that follow from a first answer, and from a timed one."""
LEVELS = (1e-9, 1e-6, 1e-3)
"""Errors by which answers are counted."""


@dataclass(frozen=True)
class Checked:
    """The answer to one program."""

    problem: str
    claims: bool
    """Whether the solver said that it was solved."""
    error: float
    """NaN without an answer."""
    why: str = ""
    """What the solver said, if it has no answer."""
    is_supported: bool = True
    """Whether the solver takes such a program at all."""

    def is_within(self, level: float) -> bool:
        """Whether it is said to be solved, and is as near."""
        return self.claims and self.error <= level

    def is_missed(self, level: float) -> bool:
        """Whether the solver takes the program, and has no such answer."""
        return self.is_supported and not self.is_within(level)

    def verdict(self) -> str:
        """What is wrong with it, in a few words."""
        if not self.claims:
            return f"not solved: {self.why}" if self.why else "not solved"
        return self.why or f"called solved, error {self.error:.1e}"


def checked(entry: Entry, problems: Sequence[RaceProblem], progress: Progress = silent) -> dict[str, list[Checked]]:
    """The answers of a solver to programs in original units, in a process of its own, by the name of its setting."""
    found = {}
    with SolverChild(entry, LIMITS) as child:
        ladder = settings_ladder(child.describe())
        finest = {"finest": ladder[-1]} if len(ladder) > 1 else {}
        for name, setting in {"default": default_setting(child.describe()), **finest}.items():
            found[name] = list[Checked]()
            for done, problem in enumerate(problems):
                progress(f"{entry.name} {problem.name}", done, len(problems))
                found[name].append(_answer(child, setting, problem))
    return found


def _answer(child: SolverChild, setting: Setting, problem: RaceProblem) -> Checked:
    """The answer to one program, as far as it can be measured."""
    form, entry = problem.forms["raw"], child.entry
    task = Task(problem.set_name, problem.name, "raw", entry.name, entry.lane, setting)
    outcome = set_up(child, task, form)
    x, why = outcome.x, "" if outcome.found else outcome.message or outcome.solver_status
    error = math.inf if x is None or x.shape != form.qp.q.shape else max(relative_gap(form, x))
    return Checked(problem.name, outcome.found, error, why, outcome.failure != Status.UNSUPPORTED)


def worst(found: Sequence[Checked], count: int) -> list[Checked]:
    """The answers with the largest errors among those that are called solved, then the others."""
    return sorted(found, key=lambda each: (not each.claims, -each.error))[:count]


def row(found: Sequence[Checked]) -> dict[str, Any]:
    """Counts: within each level, wrong and called solved, and not solved by its own word."""
    counts: dict[str, Any] = {f"within {level:.0e}": sum(each.is_within(level) for each in found) for level in LEVELS}
    claimed = [each for each in found if each.claims]
    return counts | {
        "worse, called solved": sum(not each.is_within(LEVELS[-1]) for each in claimed),
        "not solved, and said so": sum(each.is_supported and not each.claims for each in found),
        "unsupported": sum(not each.is_supported for each in found),
        "worst called solved": max((each.error for each in claimed), default=math.nan),
    }


@dataclass(frozen=True)
class Verified:
    """How much of a run was judged again."""

    rows: int
    first: int
    timed: int
    """Numbers of rows, of their first answers, and of their timed answers."""
    proofs: int
    wrong: tuple[str, ...]
    """A sentence for each row, or proof, that does not agree."""


def verify_run(run: Run, progress: Progress = silent) -> Verified:
    """Judge every stored answer of a run again; RunError for a missing problem."""
    rows = run.rows()
    by_problem, wrong, proofs = rows.groupby(["problem_set", "problem"], sort=False), list[str](), 0
    for done, ((problem_set, name), part) in enumerate(by_problem):
        progress(f"{problem_set}/{name}", done, len(by_problem))
        problem = run.problem(str(problem_set), str(name))
        proofs += len(problem.forms)
        wrong += [f"{problem_set}/{name}, {scaling}: {why}" for scaling, why in problem.wrong_proofs().items()]
        wrong += [
            f"{row['solver']} ({row['lane']}), {settings_label(row['setting']) or 'defaults'}, on {problem_set}/"
            f"{name}, {row['scaling']}, {row['timed']}: {why}"
            for row in part.to_dict("records")
            for why in _wrong(problem, row)
        ]
    first, timed = sum(rows.answer.map(len) > 0), sum(rows.timed_call >= 0)
    return Verified(len(rows), int(first), int(timed), proofs, tuple(wrong))


def _wrong(problem: RaceProblem, row: dict[Any, Any]) -> Iterator[str]:
    """What does not follow from the answers of a row."""
    if row["digest"] != problem.digest:
        yield "its digest is that of other data than the stored problem's"
        return
    form, answer = problem.forms.get(row["scaling"]), np.array(row["answer"], dtype=np.float64)
    if form is None:
        yield "the stored problem has no such scaling"
        return
    is_judged = row["status"] == Status.OK and answer.shape == form.qp.q.shape and np.isfinite(answer).all()
    yield from _differences(row, measures(problem, form, answer) if is_judged else dict.fromkeys(FIRST, math.nan))
    if row["timed_call"] < 0:
        yield from _differences(row, dict.fromkeys(TIMED, math.nan))
        return
    shares, factors, answer = (
        np.array(row[key], dtype=np.float64) for key in ("timed_shares", "timed_factors", "timed_answer")
    )
    if shares.size != 1 + len(form.windows) or factors.size not in (1, answer.size) or answer.shape != form.qp.q.shape:
        yield "the draw of its timed answer does not fit the problem"
        return
    try:
        yield from _differences(row, timed_measures(problem, mixture(form, shares, factors), answer))
    except (NotCertified, ValueError) as error:
        yield f"the data of its timed answer have no certified optimum ({error})"


def _differences(row: dict[Any, Any], found: Mapping[str, Any]) -> Iterator[str]:
    for name, new in found.items():
        old, rounding = row[name], ROUNDING * (abs(new) if name == "timed_gap" else name in OF_MODELS)
        if not (math.isclose(old, new, rel_tol=0.0, abs_tol=rounding) or (math.isnan(old) and math.isnan(new))):
            yield f"its {name.replace('_', ' ')} is {old:.3g} in the run, and {new:.3g} from its answer"
