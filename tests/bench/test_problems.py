"""Every problem of a race has a proof of its optimum."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from program_files import same_problem

from bench.problems import RaceProblem, find, sets
from bench.problems.protocol import SCALINGS, Scaling
from solvers.certificate import verify


@pytest.fixture(scope="module")
def paper() -> list[RaceProblem]:
    return list(islice(find("paper")(seed=0).problems(), 2))


@pytest.fixture(scope="module", params=sorted(sets()))
def first(request: pytest.FixtureRequest, paper: list[RaceProblem]) -> RaceProblem:
    return paper[0] if request.param == "paper" else next(find(request.param)().problems())


@pytest.mark.parametrize("scaling", SCALINGS)
def test_the_certificate_of_a_problem_is_accepted(
    first: RaceProblem, paper: list[RaceProblem], scaling: Scaling
) -> None:
    for problem in (first, paper[1]):
        verify(problem.forms[scaling].qp, problem.forms[scaling].certificate)


def test_both_scalings_have_the_same_optimal_weights(first: RaceProblem) -> None:
    scaled, raw = (first.forms[s].to_weights @ np.array(first.forms[s].certificate.x) for s in SCALINGS)
    np.testing.assert_allclose(raw, scaled, rtol=0.0, atol=1e-6 * abs(scaled).max())


def test_a_problem_is_saved_and_loaded_to_the_last_bit(first: RaceProblem, tmp_path: Path) -> None:
    first.save(tmp_path / "problem.npz")
    loaded = RaceProblem.load(tmp_path / "problem.npz")
    assert loaded.set_name == first.set_name
    assert same_problem(loaded, first)
    assert [path.name for path in tmp_path.iterdir()] == ["problem.npz"]


def test_the_same_seed_gives_the_same_bits_and_another_seed_another_problem(paper: list[RaceProblem]) -> None:
    again, other = (next(find("paper")(seed=seed).problems()) for seed in (0, 1))
    assert same_problem(again, paper[0])
    assert not same_problem(other, paper[0])


def test_the_optimum_fits_unseen_data_better_than_a_straight_line(
    paper: list[RaceProblem],
) -> None:
    problem = paper[0]
    assert problem.validation is not None
    n = problem.validation.structure.play_thresholds
    straight = problem.optimal_weights.copy()
    straight[: len(n)] = 0.0
    straight[-len(n) - 1 :] = 0.0
    assert problem.validation.error_percent(problem.optimal_weights) < problem.validation.error_percent(straight)
