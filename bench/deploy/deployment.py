"""The file of a decision: solver, setting and model for a compensator."""

from bench.deploy.actuator_model import ChosenModel
from bench.deploy.decision import Decision
from bench.races.stream.race import KIND as STREAM_KIND
from piezo_model.deployment import Deployment
from piezo_model.model import HysteresisCreepModel
from solvers import Lane

CONTINUOUS = "recursive_active_set"
"""Solver of the continuous mode."""


def deployment(decision: Decision, found: ChosenModel) -> Deployment[HysteresisCreepModel]:
    """Content of the file."""
    evidence = decision.evidence() | found.evidence()
    chosen = decision.chosen
    continuous = chosen.solver == CONTINUOUS and evidence["race"] == STREAM_KIND
    return Deployment(
        model=found.model,
        solver=chosen.solver,
        lane=Lane(chosen.lane),
        tier=chosen.tier,
        settings=chosen.settings,
        mode="continuous" if continuous else "cyclic",
        x_limits=found.model.structure.x_range,
        evidence=evidence,
    )
