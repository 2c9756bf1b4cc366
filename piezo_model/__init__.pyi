from .bank import CompensatorBank
from .compensator import Compensator
from .data_basis import DataBasis
from .dynamics import Dynamics
from .identification.error_model import IdentificationError
from .identification.identify import identify
from .identification_problem import IdentificationProblem
from .model import HysteresisCreepModel, ModelError
from .operator_state import OperatorState
from .recordings import Recording
from .self_learning import SelfLearningCompensator
from .structure import ModelStructure, StructureError

__all__ = [
    "Compensator",
    "CompensatorBank",
    "DataBasis",
    "Dynamics",
    "HysteresisCreepModel",
    "IdentificationError",
    "IdentificationProblem",
    "ModelError",
    "ModelStructure",
    "OperatorState",
    "Recording",
    "SelfLearningCompensator",
    "StructureError",
    "identify",
]
