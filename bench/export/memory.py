"""Memory of an exported compensator: that of the core's states, which Python asks of the core itself."""

from bench.export.numbers import Precision
from bench.export.settings import BLOCKS, ExportSettings
from piezo_model.core import bindings
from piezo_model.learning.layout import CONTINUOUS, CYCLIC
from piezo_model.structure import ModelStructure
from solvers.core import bindings as solvers_bindings

HEAD = 128
"""HEAD_BYTES of ``arena.h``."""
STACK = 6144
"""More than all frames together need."""


def compensator_bytes(s: ModelStructure, precision: Precision) -> int:
    """Size of the compensator's state; in single precision creep states have a rest that rounding keeps from them."""
    size: int = bindings.compensator_bytes(*s.shape)
    return size if precision == "double" else HEAD + (size - HEAD) // 2 + 4 * len(s.creep_rates) * s.lanes


def learner_bytes(s: ModelStructure, settings: ExportSettings, blocks: int = BLOCKS) -> int:
    """Size of the learner's state and of what it shares with the step, with that of an exact solver beside it; 0
    without learning."""
    if not settings.learning:
        return 0
    numbers, way = settings.numbers(s), CYCLIC if settings.cyclic else CONTINUOUS
    size = int(
        bindings.exported_learner_bytes(
            *s.shape, numbers["block"], blocks, way, 8 if settings.precision == "double" else 4
        )
    )
    return size + int(solvers_bindings.box_bytes(s.d)) if settings.solver == "box_active_set" else size


def figures(s: ModelStructure, settings: ExportSettings) -> dict[str, int]:
    """Bytes of both states, of a block between step and learner, of constants and of the stack."""
    learner = learner_bytes(s, settings)
    constants = 8 * (2 * (s.n + 1) + len(s.creep_rates) + s.dead_zones * (7 if learner else 3) + s.creep_weights + 1)
    stack = 8 * (2 * s.d + 2 * s.lanes * (1 + len(s.creep_rates)) + 4 * s.d)
    return {
        "compensator": compensator_bytes(s, settings.precision),
        "learner": learner,
        "block": learner - learner_bytes(s, settings, BLOCKS - 1),
        "constants": constants,
        "stack": -(-(stack + (STACK if learner else 1024)) // 256) * 256,
    }
