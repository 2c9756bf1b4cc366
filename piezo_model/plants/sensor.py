"""The measurement of a plant: drifting gain, delay, offset, noise and quantisation, in this order.

    d(k) = y_c + (1 + ġ k Ts) (y(k) − y_c)
    m(k) = Q( d(k − D) + b + σ ν(k) ),   Q(v) = Δ round(v / Δ)

y_c is the centre of the plant's range, ν white and Gaussian. The gain belongs to the actuator (temperature, ageing),
the rest to the sensor and its converter.
"""

from dataclasses import KW_ONLY, dataclass

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.plants.protocol import Plant
from solvers.arrays import Vector


@dataclass(eq=False)
class Sensor(Plant):
    """A plant with its sensor, itself a plant.

    Parameters
    ----------
    plant : Plant
        The measured plant, which must not be driven otherwise afterwards.
    noise_um : float
        σ, standard deviation of the noise, µm.
    quantum_um : float
        Δ, step of the converter, µm; 0 means none.
    gain_drift_per_s : float
        ġ, 1/s.
    offset_um : float
        b, µm.
    delay_samples : int
        D; the first D measurements are of the first displacement.
    seed : int
        Seed of the noise, which does not depend on how a run is cut into chunks.

    Raises
    ------
    ValueError
        If an option is out of range; the message names it.

    Examples
    --------
    >>> from piezo_model import plants
    >>> sensor = plants.Sensor(plants.get("bouc_wen"), noise_um=0.01, quantum_um=0.5, seed=1)
    >>> (sensor.run([0.0, 75.0, 150.0]) % 0.5).tolist()
    [0.0, 0.0, 0.0]
    """

    plant: Plant
    _: KW_ONLY
    noise_um: float = 0.0
    quantum_um: float = 0.0
    gain_drift_per_s: float = 0.0
    offset_um: float = 0.0
    delay_samples: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the options and start at time zero."""
        checks.not_negative(noise_um=self.noise_um, quantum_um=self.quantum_um)
        checks.finite(gain_drift_per_s=self.gain_drift_per_s, offset_um=self.offset_um)
        checks.whole(0, delay_samples=self.delay_samples, seed=self.seed)
        self.x_range, self.y_range, self.sample_time = self.plant.x_range, self.plant.y_range, self.plant.sample_time
        self._begin()

    def _begin(self) -> None:
        self._generator = np.random.Generator(np.random.SFC64(self.seed))
        self._samples = 0
        self._line = np.zeros(self.delay_samples)

    def run(self, x: ArrayLike) -> Vector:
        """Continue with a drive and measure; see :meth:`Plant.run`."""
        y = self.plant.run(x)
        if not y.size:
            return y
        t = np.arange(self._samples, self._samples + y.size, dtype=np.float64) * self.sample_time
        centre = 0.5 * (self.y_range[0] + self.y_range[1])
        drifted = centre + (1.0 + self.gain_drift_per_s * t) * (y - centre)
        if self._samples == 0:
            self._line[:] = drifted[0]
        self._samples += y.size
        passing = np.concatenate([self._line, drifted])
        self._line = passing[y.size :].copy()
        # Noise is drawn even if its size is 0: changing the size alone never changes its sequence.
        measured = passing[: y.size] + self.offset_um + self.noise_um * self._generator.standard_normal(y.size)
        if self.quantum_um > 0.0:
            measured = self.quantum_um * np.round(measured / self.quantum_um)
        return measured

    def reset(self) -> None:
        """Put the plant at rest and restart the time and the noise sequence."""
        self.plant.reset()
        self._begin()
