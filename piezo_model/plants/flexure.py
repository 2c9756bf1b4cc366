"""An actuator in a flexure: its displacement passes the modes and the delay of a stage (`piezo_model.dynamics`)."""

import copy
from dataclasses import dataclass
from typing import Self

from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.dynamics import Dynamics
from piezo_model.plants.maxwell_slip import MaxwellSlip
from piezo_model.plants.protocol import Plant
from solvers.arrays import Vector


@dataclass(eq=False)
class Flexure(Plant):
    """A plant with dynamics, itself a plant; the output is that at the end of each sampling period.

    Parameters
    ----------
    plant : Plant
        The actuator, which must not be driven otherwise afterwards.
    dynamics : Dynamics
        Modes and delay; without the lag of an amplifier.

    Raises
    ------
    ValueError
        The dynamics have an amplifier's lag, or a mode too fast for the sampling period.

    Examples
    --------
    >>> from piezo_model import Dynamics, plants
    >>> stage = plants.Flexure(plants.get("bouc_wen", sample_time=1e-4), Dynamics((500.0,), (0.01,), (1.0,), 0.0))
    >>> y = stage.run([0.0] * 10 + [75.0] * 40)  # a step makes it ring
    >>> bool(y.max() > y[-1] + 1.0)
    True
    """

    plant: Plant
    dynamics: Dynamics

    def __post_init__(self) -> None:
        """Check the dynamics and start at rest."""
        checks.require(
            lambda g: g.amplifier_lag_s == 0.0, "Dynamics without the lag of an amplifier", dynamics=self.dynamics
        )
        self.x_range, self.y_range, self.sample_time = self.plant.x_range, self.plant.y_range, self.plant.sample_time
        self.dynamics.check_sample_time(self.sample_time)
        self._begin()

    @classmethod
    def scanner(cls, sample_time: float = 125e-6) -> Self:
        """A stage that rings at 200 Hz with a damping of 1 %, whose sensor is read one sampling period late."""
        return cls(MaxwellSlip(sample_time=sample_time), Dynamics((200.0,), (0.01,), (1.0,), sample_time))

    def _begin(self) -> None:
        at_rest = copy.copy(self.plant).step(self.x_range[0])
        self._stream = self.dynamics.stream(self.sample_time, at_rest)

    def run(self, x: ArrayLike) -> Vector:
        """Continue with a drive; see :meth:`Plant.run`."""
        return self._stream(self.plant.run(x))

    def reset(self) -> None:
        """Put the stage at rest."""
        self.plant.reset()
        self._begin()
