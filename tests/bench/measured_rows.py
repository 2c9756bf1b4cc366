"""Tables of measurements in the schema of the one-shot race: a test sets the columns that it needs, and the others have
default values."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa

from bench.derived.measurements import Measurements
from bench.derived.tiers import right
from bench.messages.task import PAPER, Outcome, Row, Tier
from bench.problems.protocol import CertifiedForm, RaceProblem
from bench.race_table import ROWS, complete
from bench.races.metrics import judge
from bench.store import TIMES
from bench.timing.schedule import PERIOD_US
from piezo_model.identification_problem import Scaling
from solvers import Problem
from solvers.certificate import certify

NAN = float("nan")
ORDINARY: Row = {
    "problem_set": "paper",
    "problem": "p1",
    "d": 18,
    "solver": "daqp",
    "lane": "direct",
    "setting": "s0",
    "rung": 0,
    "scaling": "scaled",
    "start": "cold",
    "timed": "hot",
    "host": "here",
    "settings": "{}",
    "status": "answered",
    "cost_gap": 0.0,
    "violation": 0.0,
    "update_us": 0.0,
    "solve_us_p50": 1.0,
    "repeatable": True,
    "judged": 300,
}


def row(**known: object) -> Row:
    """A measurement: by default the right answer of a library in a microsecond."""
    found = complete(**{**ORDINARY, **known})
    of_all_repeats = [
        str(found[part]) for part in ("problem_set", "problem", "scaling", "solver", "lane", "setting", "start")
    ]
    us = found["update_us"] + found["solve_us_p50"]
    return {
        **found,
        "task": "-".join(of_all_repeats),
        "answer_us": us,
        "period_us": PERIOD_US,
        "periods": us / PERIOD_US,
        **known,
    }


def columns_at(index: int, columns: Row) -> Row:
    """The columns at a rung or a problem, for which a list holds a value each."""
    return {name: value[index] if isinstance(value, list) else value for name, value in columns.items()}


def ladder(gaps: dict[str, list[float]], **known: object) -> list[Row]:
    """The settings s0, s1, … of a solver on some problems by their cost gaps, from loose to tight; NaN is a setting
    that failed.

    A list holds a value for each rung.
    """
    return [
        row(
            **{
                "problem": problem,
                "setting": f"s{rung}",
                "rung": rung,
                "cost_gap": gap,
                "status": "solver_failed" if np.isnan(gap) else "answered",
                **columns_at(rung, known),
            }
        )
        for problem, by_rung in gaps.items()
        for rung, gap in enumerate(by_rung)
    ]


def steps(gaps: dict[str, list[float]], **known: object) -> list[Row]:
    """The paper's method of 100 and of 15 200 steps."""
    settings, periods = ['{"steps": 100}', '{"steps": 15200}'], [100.0, 15_200.0]
    return ladder(gaps, solver=PAPER, lane="kernel", settings=settings, periods=periods, **known)


def table(rows: list[Row]) -> pd.DataFrame:
    """The rows as a run returns them."""
    return pa.Table.from_pylist(list(rows), ROWS).to_pandas()


def form_of(qp: Problem, c: float = 1.0, **more: object) -> CertifiedForm:
    """A program with its proof, whose variables are weights."""
    return CertifiedForm(qp, c, np.eye(qp.q.size), certify(qp, np.zeros(qp.q.size)), **more)


def judged(problem: RaceProblem, scaling: Scaling, outcome: Outcome) -> SimpleNamespace:
    """The columns of a judged outcome; those that it does not have are as in a row."""
    return SimpleNamespace(**complete(**judge(problem, scaling, outcome)))


def is_right(found: SimpleNamespace, tier: Tier) -> bool:
    """Whether a judged answer meets a tier."""
    return bool(right(table([vars(found)]), tier).item())


def measured(rows: list[Row]) -> Measurements:
    """Measurements of these rows, without raw times."""
    return Measurements(table(rows), TIMES.empty_table().to_pandas())
