"""The file of a decision: solver, setting and model for a compensator."""

from bench.deploy.actuator_model import ChosenModel
from bench.deploy.decision import Decision
from piezo_model.deployment import Deployment
from piezo_model.model import HysteresisCreepModel
from solvers import Lane


def deployment(decision: Decision, found: ChosenModel) -> Deployment[HysteresisCreepModel]:
    """Content of the file; the mode is the one that `docs/learning.md` recommends."""
    evidence = decision.evidence() | found.evidence()
    chosen = decision.chosen
    return Deployment(
        model=found.model,
        solver=chosen.solver,
        lane=Lane(chosen.lane),
        tier=chosen.tier,
        settings=chosen.settings,
        mode="continuous",
        x_limits=found.model.structure.x_range,
        evidence=evidence,
    )
