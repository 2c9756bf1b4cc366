"""Fig. 1: after the data basis is built, any solver learns the weights from it while the compensator is running."""

import numpy as np
import pytest
from box_programs import set_up
from learning_loops import at_work
from qpsolvers import Problem

from piezo_model import SelfLearningCompensator
from piezo_model.identification.error_model import ProgramSolver
from piezo_model.learning.events import Phase


def learning(solver: str, learn_s: float = 20.0, **options: object) -> SelfLearningCompensator:
    """A learner at the beginning of its learning phase."""
    plant, learner, y_ref = at_work(2.1, "cyclic", solver, build_s=2.0, learn_s=learn_s, **options)
    learner.run(y_ref, plant.run)
    assert learner.phase is Phase.LEARN
    return learner


def cost_after(learner: SelfLearningCompensator, samples: int) -> float:
    """Cost on the learned data of the weights in use after further samples; new weights take effect a block later."""
    learner.observe(np.zeros(samples), np.full(samples, np.nan))
    learner.run(np.zeros(2 * learner._block), lambda x: np.full_like(x, np.nan))
    return learner.problem.cost(learner.model.weights)


def test_an_exact_solver_has_its_answer_after_the_samples_that_it_takes() -> None:
    learner = learning("box_active_set", solve_delay_samples=17)
    wait = -(-17 // learner._block) * learner._block  # a phase ends with a block
    learner.observe(np.zeros(wait - 1), np.full(wait - 1, np.nan))
    assert learner.phase is Phase.LEARN
    problem, weights = learner.problem, learner.model.weights
    after = cost_after(learner, 1)
    assert (learner.phase, learner.counts["hand_overs"]) == (Phase.RESET, 1)
    assert after < 0.02 * problem.cost(weights)
    np.testing.assert_allclose(learner.model.weights, ProgramSolver().optimum(problem), rtol=1e-9, atol=1e-12)


def test_a_solver_of_steps_takes_one_a_sample_and_comes_to_the_exact_answer() -> None:
    exact = cost_after(learning("box_active_set", solve_delay_samples=1), 1)
    costs = [cost_after(learning("projected_difference", learn_s), 20_000) for learn_s in (0.001, 5.0, 10.0, 20.0)]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] - exact < 0.05 * (costs[0] - exact)


@pytest.mark.parametrize(("options", "ratio"), [({}, 0.5), ({"step_ratio": 0.25}, 0.25)])
def test_the_steps_are_those_of_the_difference_equation(options: dict[str, float], ratio: float) -> None:
    learner = learning("projected_difference", 0.3, solver_options=options)
    core = learner._core
    q, lower, z = (core[name].copy() for name in ("q", "lower", "start"))
    P = core["P"].reshape(q.size, q.size)
    solver = set_up("projected_difference", Problem(P, q, lb=lower), steps=0, **options)
    solver.solve()
    eta = solver.solution().extras["eta"]
    assert 0.999 <= eta * np.linalg.eigvalsh(P)[-1] / (2.0 * ratio) <= 1.0 + 1e-13
    steps = -(-300 // learner._block) * learner._block
    for _ in range(steps):
        z = np.maximum(z - eta * (P @ z + q), lower)
    learner.observe(np.zeros(steps), np.full(steps, np.nan))
    assert learner.counts["hand_overs"] == 1
    np.testing.assert_allclose(core["answer"], z, rtol=1e-9, atol=1e-12)


def test_the_program_is_that_of_the_identification_of_the_same_samples() -> None:
    learner = learning("box_active_set", solve_delay_samples=100)
    core, form = learner._core, learner.problem.form()
    start = np.maximum(form.variables(learner.model.weights), form.qp.lb)
    for name, expected in (("P", form.qp.P.ravel()), ("q", form.qp.q), ("start", start)):
        np.testing.assert_allclose(core[name], expected, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(core["lower"], form.qp.lb, rtol=1e-11)
