"""A two-axis parallel-kinematic positioning system: two axes that move one platform, and its sensors.

    y(k) = Q( C p(k) + σ ν(k) ),   p_i the displacement of axis i (`axis`)

The cross-coupling C (2 × 2) describes how much each axis moves the platform in the direction of the other: joints are
not at right angles, sensors not aligned with the actuators. So neither direction of y depends on one drive alone, but
both outputs of the decoupling matrix D = C⁻¹ do: `decoupling` estimates D, and `learning` closes one self-learning loop
for each axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.core import Stateful
from piezo_model.stage.axis import Axis
from solvers.arrays import Matrix


def coupled(C: Matrix, p: Matrix) -> Matrix:
    """C p(k) for p (N, 2); written out, since a matrix product may round a single sample differently."""
    return np.asarray(C[:, 0] * p[:, :1] + C[:, 1] * p[:, 1:])


@dataclass(kw_only=True, eq=False)
class Stage(Stateful):
    """The positioning system of the module.

    Parameters
    ----------
    axes : two Axis
        Two axes of the same sampling period, which must not be driven in any other way afterwards.
    coupling : array (2, 2)
        The regular matrix C.
    noise_um, quantum_um : float
        σ and the step of the converter Q, µm; 0 means none.
    seed : int
        Seed of the noise, which does not depend on how a run is cut into chunks.

    Raises
    ------
    ValueError
        If an option is out of range; the message names it.

    Examples
    --------
    >>> from piezo_model import plants
    >>> axes = tuple(Axis(actuators=(plants.get(name),)) for name in ("relay_preisach", "dense_prandtl_ishlinskii"))
    >>> stage = Stage(axes=axes, coupling=((1.0, 0.05), (-0.03, 1.0)))
    >>> stage.run(np.full((100, 2), 75.0)).shape
    (100, 2)
    """

    axes: tuple[Axis, Axis]
    coupling: ArrayLike = ((1.0, 0.0), (0.0, 1.0))
    noise_um: float = 0.0
    quantum_um: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the options and go to rest."""
        if len(self.axes) != 2 or self.axes[0] is self.axes[1]:
            raise ValueError("a stage has two axes, which must be two objects")
        if self.axes[0].sample_time != self.axes[1].sample_time:
            raise ValueError(
                f"the axes must have the same sample_time, not {self.axes[0].sample_time} and "
                f"{self.axes[1].sample_time}"
            )
        self.C: Matrix = np.array(self.coupling, dtype=np.float64)
        if self.C.shape != (2, 2) or not np.isfinite(self.C).all() or np.linalg.cond(self.C) > 1e6:
            raise ValueError(f"coupling must be a regular matrix of 2 by 2 numbers, not {self.C.tolist()}")
        checks.not_negative(noise_um=self.noise_um, quantum_um=self.quantum_um)
        checks.whole(0, seed=self.seed)
        self.sample_time = self.axes[0].sample_time
        self._generator = np.random.Generator(np.random.SFC64(self.seed))

    def run(self, x: ArrayLike) -> Matrix:
        """Continue with a drive.

        Parameters
        ----------
        x : array (N, 2)
            Drives of the two axes, V.

        Returns
        -------
        array (N, 2)
            Measured displacements of the platform, µm; row k depends on x[0..k].

        Raises
        ------
        ValueError
            If the drive has another shape or is not finite; the stage is unchanged.
        """
        (x,) = checks.columns(2, x=x)
        checks.finite_arrays(x=x)
        y = coupled(self.C, np.column_stack([axis.run(x[:, i]) for i, axis in enumerate(self.axes)]))
        # Noise is drawn even if its size is 0: changing the size alone never changes its sequence.
        y += self.noise_um * self._generator.standard_normal(y.shape)
        return self.quantum_um * np.round(y / self.quantum_um) if self.quantum_um > 0.0 else y

    def step(self, x: ArrayLike) -> Matrix:
        """Continue with one sample: x (2,) in V, displacements (2,) in µm, to the last bit as :meth:`run`."""
        return np.asarray(self.run(np.asarray(x, dtype=np.float64)[None])[0])
