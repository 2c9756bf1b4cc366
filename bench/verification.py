"""Whether the accuracy in a run follows from the answers that are stored in it, judged again in exact arithmetic.

The certificates are replayed from the data of the problems; the first answer of each row, and the worst judged timed
one on the data of its draw, have to give the stored cost gap and violation to the last bit. This shows that gaps follow
from stored answers. It does not show who gave the answers, nor that statuses, iterations or times are true.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.derived.measurements import rows_of
from bench.messages.progress import Progress, silent
from bench.messages.task import Status
from bench.problems.fresh import mixture
from bench.problems.protocol import RaceProblem
from bench.races.metrics import relative_gap
from bench.report.words import settings_label
from bench.store import Run
from solvers.certificate import NotCertified


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
    """Judge every stored answer of a one-shot or anytime race again; RunError for another run or a missing problem."""
    rows = rows_of(run)
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
    gaps = (math.nan, math.nan)
    if row["status"] == Status.OK and answer.shape == form.qp.q.shape and np.isfinite(answer).all():
        gaps = relative_gap(form, answer)
    yield from _differences(("cost gap", "violation"), (row["cost_gap"], row["violation"]), gaps)
    if row["timed_call"] < 0:
        yield from _differences(("timed gap",), (row["timed_gap"],), (math.nan,))
        return
    shares, factors, answer = (
        np.array(row[key], dtype=np.float64) for key in ("timed_shares", "timed_factors", "timed_answer")
    )
    if shares.size != 1 + len(form.windows) or factors.size not in (1, answer.size) or answer.shape != form.qp.q.shape:
        yield "the draw of its timed answer does not fit the problem"
        return
    try:
        timed = relative_gap(mixture(form, shares, factors), answer)
    except (NotCertified, ValueError) as error:
        yield f"the data of its timed answer have no certified optimum ({error})"
        return
    stored = (row["timed_gap"], row["timed_violation"])
    yield from _differences(("timed gap", "timed violation"), stored, (max(timed), timed[1]))


def _differences(names: tuple[str, ...], stored: tuple[float, ...], found: tuple[float, ...]) -> Iterator[str]:
    for name, old, new in zip(names, stored, found, strict=True):
        if old != new and not (math.isnan(old) and math.isnan(new)):
            yield f"its {name} is {old:.3g} in the run, and {new:.3g} from its answer"
