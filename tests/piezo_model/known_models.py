"""Known models and drives, from which an identification has to recover the model."""

from pathlib import Path
from typing import Any

import numpy as np

from piezo_model import DataBasis, HysteresisCreepModel, ModelStructure, OperatorState


def structure(**changes: object) -> ModelStructure:
    return ModelStructure.equidistant(
        **{
            "n": 3,
            "m": 1,
            "x_range": (0, 100),
            "y_range": (-20, 20),
            "creep_rates": (10.0, 1.0),
            "sample_time": 5e-3,
            "offset": True,
            **changes,
        }
    )


def true_model(s: ModelStructure, bend: float = 0.2) -> HysteresisCreepModel:
    """A model whose slopes of S⁻¹ rise from 1 − ``bend`` to 1 + ``bend`` over its range."""
    v = np.full(s.d, 0.1)
    v[s.slices[1]] = np.linspace(1.0 - bend, 1.0 + bend, s.dead_zones)
    return HysteresisCreepModel.from_weights(s, s.slope_map @ v)


def a_drive(size: int = 6000, fine: int = 1) -> np.ndarray:
    """Drive over the whole range, V, with ``fine`` samples per sampling period."""
    t = np.arange(size * fine) / fine
    return 50 + 30 * np.sin(t / 40) + 20 * np.sin(t / 131 + 1)


def basis_of(s: ModelStructure, x: np.ndarray, y: np.ndarray, state: OperatorState | None = None) -> DataBasis:
    """The data basis of one recording."""
    basis = DataBasis(s, state)
    basis.update(x, y)
    return basis


def reloaded(thing: Any, folder: Path) -> Any:
    """What a file of it gives."""
    thing.save(folder / "saved")
    return type(thing).load(folder / "saved")


def undisplaced(s: ModelStructure, unit_x: float) -> OperatorState:
    """States of a stage that rests at an input in normalised units, where no play is displaced."""
    return OperatorState(np.full(s.lanes, unit_x), np.full(len(s.creep_rates) * s.lanes, unit_x))
