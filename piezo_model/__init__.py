"""Hysteresis and creep of piezo actuators: operators, model, inverse, identification, compensation, simulated stages."""

from piezo_model.compensator import Compensator
from piezo_model.data_basis import DataBasis
from piezo_model.identification.fitting import IdentificationError
from piezo_model.identification.identify import identify
from piezo_model.identification_problem import IdentificationProblem
from piezo_model.model import HysteresisCreepModel, ModelError
from piezo_model.operator_state import OperatorState
from piezo_model.recordings import Recording
from piezo_model.self_learning import SelfLearningCompensator
from piezo_model.structure import ModelStructure, StructureError

__all__ = ["Compensator", "DataBasis", "HysteresisCreepModel", "IdentificationError", "IdentificationProblem",
           "ModelError", "ModelStructure", "OperatorState", "Recording", "SelfLearningCompensator",
           "StructureError", "identify"]
