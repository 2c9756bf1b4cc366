"""What comes back from a solver's process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from solvers.arrays import Vector
from solvers.protocol import Nanoseconds


@dataclass
class Outcome:
    """What came back from a child."""

    failure: str = ""
    """Nothing, "unsupported", "adapter_failed" or "out_of_memory"."""
    message: str = ""
    """The sentence that goes with a failure."""
    found: bool = False
    """What the solver itself says."""
    x: Vector | None = None
    y: Vector | None = None
    z: Vector | None = None
    z_box: Vector | None = None
    """Answer and duals in qpsolvers' conventions."""
    solver_status: str = ""
    reported_us: float = float("nan")
    iterations: int = -1
    mutated: bool = False
    """Whether the solver wrote into the arrays that it was given."""
    repeatable: bool = True
    """Whether the same data gave the same bits again."""
    asked: Mapping[str, Any] = field(default_factory=dict)
    """The settings that the solver was given."""
    returned: str = ""
    """Type of the answer where it is no array."""
    seen: tuple[str, ...] = ()
    """What the process did that it must not."""
    preemptions: int = 0
    """How often the process was taken off its core while it was timed."""
    setup_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    update_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    solve_ns: Nanoseconds = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
