"""The ladders of the libraries: their rungs, and the accuracy that they reach."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from answered_pairs import pair
from programs import solver_class

import solvers
from bench.problems.protocol import CertifiedForm
from bench.problems.simulation import Experiment
from solvers import Entry, Lane, Solver, Unsupported, registry
from solvers.adapter import LibrarySolver
from solvers.certificate import exact_cost_gap
from solvers.protocol import setting_text

LIBRARIES = [entry for entry in solvers.entries() if entry.name not in registry.OURS]
OURS = [entry for entry in solvers.entries() if entry.lane is Lane.KERNEL and entry.name in registry.OURS]

COMPILES = ("qpax",)
"""Solvers that compile for every setting, which takes seconds; only one of their rungs is tested."""


def named(entries: list[Entry]) -> list[object]:
    return [
        pytest.param(
            entry,
            id=f"{entry.lane}-{entry.name}",
            marks=[pytest.mark.slow] * (entry.name in COMPILES and entry.lane is Lane.QPSOLVERS),
        )
        for entry in entries
    ]


@cache
def two_problems() -> tuple[CertifiedForm, ...]:
    """Two problems of the set paper, scaled: the largest and a common ratio of |V*| to V* + c."""
    return tuple(
        # a seed that no race uses
        Experiment(plant, drive, seed=1000).problem("paper", f"{plant}-{drive}").forms["scaled"]
        for plant, drive in (("bouc_wen", "staircase"), ("dense_prandtl_ishlinskii", "random_walk"))
    )


def accuracy(solver: Solver, form: CertifiedForm) -> float:
    """The exact relative cost gap or violation, whichever is larger; infinite if the library reports failure."""
    solver.setup(form.qp)
    x = np.array(solver.solve())
    if not solver.solution().found:
        return float("inf")
    gap = exact_cost_gap(form.qp, form.certificate, x, form.c)
    return max(gap.relative, gap.violation / max(map(abs, form.certificate.x)))


@pytest.mark.parametrize("entry", named([*LIBRARIES, *OURS]))
def test_a_ladder_has_at_most_eight_rungs_each_tighter_than_the_one_below_and_found_by_its_name_for_any_constant(
    entry: Entry,
) -> None:
    cls = solver_class(entry)
    assert issubclass(cls, LibrarySolver) or entry in OURS
    names = [setting_text({**cls.fixed_settings, **rung}) for rung in cls.ladder(1.0)]
    assert (len(set(names)), [*cls.exponents]) == (len(names), sorted(cls.exponents))
    assert len(cls.exponents) in (0, len(names))
    assert cls.exponents or entry.lane not in (Lane.QPSOLVERS, Lane.CVXPY) or len(names) == 1
    for c in (1e-4, 0.2, 1.0, 2.5e6):
        ladder = cls.ladder(c)
        assert 1 <= len(ladder) <= 8
        assert [cls.at(name, c) for name in names] == [dict(rung) for rung in ladder]
        for lower, upper in pairwise(ladder):
            assert lower != upper
            assert not issubclass(cls, LibrarySolver) or all(
                upper[name] <= lower[name] for name in cls.library.tolerances
            )
        default = cls.at(setting_text(cls.fixed_settings), c)
        assert default == {} or setting_text(cls.fixed_settings) in names
    with pytest.raises(ValueError, match=r"has no setting '\{\"no\": 1\}'; its ladder goes from \{.* to \{"):
        cls.at(setting_text({"no": 1}), 1.0)


@pytest.mark.filterwarnings("ignore::UserWarning")  # qpsolvers and cvxpy warn if a rung is too tight
@pytest.mark.parametrize("entry", named(LIBRARIES))
def test_every_setting_of_a_ladder_is_one_that_the_library_takes(entry: Entry) -> None:
    cls = solver_class(entry)
    problem = pair("rows", 6)
    try:
        cls().setup(problem.problems[0])
    except Unsupported:
        problem = pair("one-sided", 6)
    ladder = cls.ladder(1.0)
    for rung in ladder[:1] if entry.name in COMPILES else (ladder[0], ladder[len(ladder) // 2], ladder[-1]):
        solver = cls(**rung)
        solver.setup(problem.problems[0])
        x = solver.solve()
        if solver.solution().found:
            assert problem.error(x) < 3.0
        else:  # the upper rungs may ask for more than rounding allows
            assert rung is not ladder[0] or "steps" in rung


@pytest.mark.parametrize("entry", named([entry for entry in LIBRARIES if entry.lane in (Lane.DIRECT, Lane.KERNEL)]))
def test_some_rung_reaches_a_billionth_on_two_problems(entry: Entry) -> None:
    cls, forms = solver_class(entry), two_problems()
    assert any(
        max(accuracy(cls(**rung), form) for form, rung in zip(forms, rungs, strict=True)) <= 1e-9
        for rungs in zip(*(reversed(cls.ladder(form.c)) for form in forms), strict=True)
    )
