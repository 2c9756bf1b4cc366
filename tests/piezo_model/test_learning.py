"""A learning phase with any solver, and the settings."""


import numpy as np
import pytest
from learning_loops import sensor, structure_for

from piezo_model.data_basis import DataBasis
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.learning.phase import LearningPhase
from piezo_model.learning.settings import LearningSettings
from piezo_model.signals import decaying_triangle
from solvers.kernels.projected_step import run


@pytest.fixture(scope="module")
def problem() -> IdentificationProblem:
    plant = sensor()
    x = decaying_triangle(duration_s=4.0, sample_time=plant.sample_time, low=0.0, high=150.0)
    basis = DataBasis(structure_for(plant))
    basis.update(x, plant.run(x))
    return basis.problem()


def test_an_exact_solver_has_its_answer_after_the_samples_that_it_takes(problem: IdentificationProblem) -> None:
    start = problem.structure.straight_line
    phase = LearningPhase("box_active_set", problem, start, samples_to_solve=17)
    assert phase.ready_after == 17
    measured = LearningPhase("box_active_set", problem, start)
    assert measured.ready_after >= 1
    np.testing.assert_array_equal(measured.weights, phase.weights)
    assert problem.cost(phase.weights) < 0.02 * problem.cost(start)


def test_a_solver_of_steps_takes_them_where_it_is_told_and_comes_to_the_exact_answer(problem: IdentificationProblem) -> None:
    phase = LearningPhase("projected_difference", problem, problem.structure.straight_line)
    exact = LearningPhase("box_active_set", problem, problem.structure.straight_line, samples_to_solve=1)
    costs = [problem.cost(phase.weights)]
    for _ in range(4):
        s = phase.arrays
        run(s.work, s.d, 5000, -1.0, s.A, s.b, s.index, s.dual, s.idual)
        costs.append(problem.cost(phase.weights))
    assert phase.ready_after == 0
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] - problem.cost(exact.weights) < 0.05 * (costs[0] - problem.cost(exact.weights))


@pytest.mark.parametrize("solver", ["box_active_set", "projected_difference"])
def test_a_phase_goes_on_from_its_answer_bit_for_bit(solver: str, problem: IdentificationProblem) -> None:
    phases = [LearningPhase(solver, problem, problem.structure.straight_line, 3)]
    advance(phases[0], 137)
    phases.append(LearningPhase(solver, problem, problem.structure.straight_line, answer=phases[0].answer.copy()))
    for phase in phases:
        advance(phase, 200)
    np.testing.assert_array_equal(phases[0].weights, phases[1].weights)


def advance(phase: LearningPhase, steps: int) -> None:
    s = phase.arrays
    run(s.work, s.d, steps if s.d else 0, -1.0, s.A, s.b, s.index, s.dual, s.idual)


def test_options_reach_the_solver(problem: IdentificationProblem) -> None:
    with pytest.raises(ValueError, match="step_ratio must lie between 0 and 1"):
        LearningPhase("projected_difference", problem, problem.structure.straight_line, options={"step_ratio": 3.0})


# Settings


@pytest.mark.parametrize(("options", "sentence"), [
    ({"mode": "sideways"}, "mode must be one of cyclic, continuous, not 'sideways'"),
    ({"build_s": 0.0}, "build_s must be a positive number of seconds, not 0.0"),
    ({"learn_s": float("nan")}, "learn_s must be a positive number of seconds, not nan"),
    ({"proximal": -1.0}, "proximal must be at least 0 and below 1, not -1.0"),
    ({"samples_to_solve": 0}, "samples_to_solve must be a whole number of at least 1, not 0"),
    ({"solver": "nobody"}, "there is no solver 'nobody'"),
])
def test_settings_that_cannot_be_are_refused_in_one_sentence(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence.replace("(", r"\(")):
        LearningSettings(**options)  # type: ignore[arg-type]


def test_settings_survive_their_dictionary_and_unknown_ones_are_named() -> None:
    settings_ = LearningSettings(x_limits=(0.0, 1.0), solver_options={"lane": "kernel"})
    assert LearningSettings.from_dict(settings_.to_dict()) == settings_
    with pytest.raises(ValueError, match="there is no setting 'speed'; known are reset_s"):
        LearningSettings.from_dict({"speed": 1})
