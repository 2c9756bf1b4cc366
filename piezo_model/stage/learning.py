"""Self-learning compensation of a two-axis stage: one loop per axis behind the decoupling matrix.

    q_r = D y_r,   x_i = learner i (q_r,i, q_i),   q = D y

In the coordinates q each output depends on one drive (`decoupling`), so the two loops are independent.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from piezo_model import checks
from piezo_model.core import Stateful
from piezo_model.self_learning import SelfLearningCompensator
from piezo_model.stage.stage import coupled
from solvers.arrays import Matrix


class SelfLearningStage(Stateful):
    """Two self-learning compensators behind a decoupling matrix.

    Parameters
    ----------
    learners : two SelfLearningCompensator
        One per axis; q_i is the output of its structure.
    decoupling : array (2, 2)
        The matrix D.

    Examples
    --------
    >>> from piezo_model import ModelStructure, plants
    >>> from piezo_model.stage.stage import Stage
    >>> from piezo_model.stage.axis import Axis
    >>> axes = tuple(Axis(actuators=(plants.get("relay_preisach"),)) for _ in range(2))
    >>> stage = Stage(axes=axes, coupling=((1.0, 0.05), (-0.03, 1.0)))
    >>> learners = [SelfLearningCompensator(ModelStructure.equidistant(
    ...     n=5, m=3, x_range=axis.x_range, y_range=axis.y_range, creep_rates=(10.0, 1.0),
    ...     sample_time=stage.sample_time),
    ...     x_limits=axis.x_range) for axis in axes]
    >>> loop = SelfLearningStage(learners, np.linalg.inv(stage.C))
    >>> x, y = loop.run(np.zeros((100, 2)), stage.run)
    >>> x.shape, y.shape
    ((100, 2), (100, 2))
    """

    def __init__(self, learners: Sequence[SelfLearningCompensator], decoupling: ArrayLike) -> None:
        if len(learners) != 2 or learners[0] is learners[1]:
            raise ValueError("a stage has two axes, and each has a learner of its own")
        self.learners = tuple(learners)
        self.D: Matrix = np.array(decoupling, dtype=np.float64)
        if self.D.shape != (2, 2) or not np.isfinite(self.D).all():
            raise ValueError(f"the decoupling matrix must be 2 by 2 numbers, not {self.D.tolist()}")

    def step(self, y_ref: ArrayLike, y_measured_before: ArrayLike) -> Matrix:
        """Process one sample like :meth:`SelfLearningCompensator.step`; references, outputs and drives are (2,)."""
        q_ref, q = coupled(self.D, np.array([y_ref, y_measured_before], dtype=np.float64))
        return np.array([learner.step(float(q_ref[i]), float(q[i])) for i, learner in enumerate(self.learners)])

    def run(self, y_ref: ArrayLike, stage: Callable[[Matrix], Matrix]) -> tuple[Matrix, Matrix]:
        """Close both loops over a stage, a function from drives (N, 2) to measured outputs (N, 2).

        Returns the same bits as ``step`` sample by sample, in chunks that end where the weights of either axis may
        change.

        Returns
        -------
        x, y : array (N, 2)
            Drives and measured outputs.
        """
        (y_ref,) = checks.columns(2, y_ref=y_ref)
        q_ref = coupled(self.D, y_ref)
        x, y = np.empty_like(q_ref), np.empty_like(q_ref)
        done = 0
        while done < len(q_ref):
            count = min(learner.samples_until_change() for learner in self.learners)
            chunk = slice(done, min(done + count, len(q_ref)))
            for i, learner in enumerate(self.learners):
                x[chunk, i] = learner.drive(q_ref[chunk, i])
            y[chunk] = stage(x[chunk])
            q = coupled(self.D, y[chunk])
            for i, learner in enumerate(self.learners):
                learner.observe(x[chunk, i], q[:, i])
            done = chunk.stop
        return x, y
