"""Verification that the accuracies of a run follow from its stored answers, judged again without timing.

The certificates are replayed from the data of the problems; the first answer of each row, and the worst judged timed
one on the data of its draw, have to give the stored gaps, violations and errors of the model, and a worst one that
misses a tier is among the misses that are counted. A row without a timed answer is one of a failure, or of a program
whose fresh data have no proof. This shows that these follow from stored answers. It does not show who gave the answers,
nor that statuses, iterations or times are true.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from bench.derived.tiers import TOLERANCE
from bench.messages.task import Progress, Status
from bench.problems.fresh import FreshData, mixture
from bench.problems.protocol import RaceProblem
from bench.race_table import MISSES
from bench.races.metrics import measures, timed_measures
from bench.report.words import settings_label
from bench.store import Run
from solvers.certificate import NotCertified

ROUNDING = 1e-9
"""Largest relative difference of a timed gap, and absolute one of an error of a model, that another order of additions
made, as of BLAS in runs of before: V* + c cancels to 1e-4 of c where the fit is good. Other measures are exact."""
OF_MODELS = ("weight_error", "model_error_percent", "stage_excess", "timed_stage_excess")
FIRST = ("cost_gap", "violation", *OF_MODELS[:3])
TIMED = ("timed_gap", "timed_violation", *OF_MODELS[3:])
"""Columns that follow from a first answer, and from a timed one."""


def verify_run(run: Run, progress: Progress) -> dict[str, Any]:
    """Judge every stored answer of a run again: the numbers of ``rows``, of their ``first`` and ``timed`` answers, and
    of ``proofs``, and in ``wrong`` a sentence for each row, or proof, that does not agree. RunError for a missing
    problem."""
    rows = run.rows()
    by_problem, wrong, proofs = rows.groupby(["problem_set", "problem"], sort=False), list[str](), 0
    for done, ((problem_set, name), group) in enumerate(by_problem):
        progress(f"{problem_set}/{name}", done, len(by_problem))
        problem = run.problem(str(problem_set), str(name))
        proofs += len(problem.forms)
        wrong += [f"{problem_set}/{name}, {scaling}: {why}" for scaling, why in problem.wrong_proofs().items()]
        wrong += [
            f"{row['solver']} ({row['lane']}), {settings_label(row['setting']) or 'defaults'}, on {problem_set}/"
            f"{name}, {row['scaling']}, {row['timed']}: {why}"
            for row in group.to_dict("records")
            for why in _wrong(problem, row)
        ]
    first, timed = sum(rows.answer.map(len) > 0), sum(rows.timed_call >= 0)
    return {"rows": len(rows), "first": int(first), "timed": int(timed), "proofs": proofs, "wrong": wrong}


def _wrong(problem: RaceProblem, row: dict[Any, Any]) -> Iterator[str]:
    """The differences between a row and its answers."""
    if row["digest"] != problem.digest:
        yield "its digest does not match the stored problem"
        return
    form, answer = problem.forms.get(row["scaling"]), np.array(row["answer"], dtype=np.float64)
    if form is None:
        yield "the stored problem has no such scaling"
        return
    is_judged = row["status"] == Status.ANSWERED and answer.shape == form.qp.q.shape and np.isfinite(answer).all()
    yield from _differences(row, measures(problem, form, answer) if is_judged else dict.fromkeys(FIRST, math.nan))
    if row["timed_call"] < 0:
        yield from _differences(row, dict.fromkeys(TIMED, math.nan) | dict.fromkeys(("judged", *MISSES.values()), 0))
        if (is_judged or row["samples"]) and FreshData(form, 1).certified(0):
            yield "its timed answers are missing"
        return
    for tier, name in MISSES.items():
        if not (row["timed_gap"] > TOLERANCE[tier]) <= row[name] <= row["judged"] <= row["samples"]:
            yield (
                f"{name} is {row[name]} of {row['judged']} judged answers to {row['samples']} calls, and its timed gap "
                f"{row['timed_gap']:.3g}"
            )
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


def _differences(row: dict[Any, Any], judged: Mapping[str, Any]) -> Iterator[str]:
    for name, new in judged.items():
        old, rounding = row[name], ROUNDING * (abs(new) if name == "timed_gap" else name in OF_MODELS)
        if not (math.isclose(old, new, rel_tol=0.0, abs_tol=rounding) or (math.isnan(old) and math.isnan(new))):
            yield f"its {name.replace('_', ' ')} is {old:.3g} in the run, and {new:.3g} from its answer"
