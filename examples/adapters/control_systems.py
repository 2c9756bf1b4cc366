"""Model, inverse and compensator as nonlinear discrete-time systems of python-control.

Run as a script, it connects a compensator and an actuator in series.

    z(k+1) = f(z(k), u(k)),   output(k) = g(z(k), u(k))

with the states z of the play and creep operators in normalised units. All three have direct feedthrough: output at a
sample depends on the input at the same sample. So inverse and model in series are the identity, and a compensator can
be connected to a plant like any other block; a feedback loop from the plant's output to the reference needs a delay, as
in any digital controller.

``control.input_output_response`` interpolates inputs, so an input that is not finite affects the next sample, too.
"""

from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any

import control
import numpy as np

from piezo_model import Compensator, HysteresisCreepModel, ModelStructure, OperatorState, identify, plants
from piezo_model.compensator import BUMP, CORRECTION
from piezo_model.signals import decaying_triangle, multi_sine
from solvers.arrays import Vector


def initial_states(structure: ModelStructure, state: OperatorState | None = None) -> Vector:
    """States of the operators as one vector (states,): play with thresholds 0 … r_n, then creep rate by rate; by
    default those of a compensator's stage at rest.

    Examples
    --------
    >>> structure = ModelStructure.equidistant(n=2, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(1.0,),
    ...                                        sample_time=1e-3)
    >>> initial_states(structure).shape
    (6,)
    """
    state = OperatorState.before_drive(structure) if state is None else state
    state.check_fits(structure)
    thresholds, rates = structure.n + 1, len(structure.creep_rates)
    return np.concatenate(
        [state.play[:thresholds], state.creep.reshape(rates, structure.lanes)[:, :thresholds].ravel()]
    )


def _operators(structure: ModelStructure, z: Vector) -> OperatorState:
    """The states (states,) in the layout of the core."""
    play, *creep = z.reshape(-1, structure.n + 1)
    return OperatorState.from_dict({"play": play, "creep": creep}, structure)


def model_system(model: HysteresisCreepModel, name: str = "actuator") -> control.NonlinearIOSystem:
    """The model as a system from the drive to the displacement.

    Parameters
    ----------
    model : HysteresisCreepModel
    name : str

    Returns
    -------
    control.NonlinearIOSystem
        With input ``drive``, output ``displacement`` and the sampling period of the structure; its initial state is
        :func:`initial_states`.

    Examples
    --------
    >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
    ...                                        sample_time=1e-3)
    >>> model = HysteresisCreepModel.from_weights(structure, [1.0, 2.0])
    >>> system = model_system(model)
    >>> t, x = np.arange(3) * 1e-3, [0.0, 1.0, 0.0]
    >>> control.input_output_response(system, t, x, initial_states(structure)).outputs.tolist()
    [0.0, 0.75, 0.25]
    """
    s = model.structure

    def advance(z: Vector, u: Vector) -> tuple[float, OperatorState]:
        y, state = model.advance([u[0]], _operators(s, z))
        return float(y[0]), state

    return _system(s, advance, "drive", "displacement", name)


def compensator_system(compensator: Compensator, name: str = "compensator") -> control.NonlinearIOSystem:
    """The compensator, which is copied, as a system from the reference to the drive.

    The system has its model, limits and rate limit, but neither the bump of a change of model nor the correction
    of integral action.
    """
    own = deepcopy(compensator)
    s, drive = own.model.structure, own.drive.copy()
    drive[[BUMP, CORRECTION]] = 0.0

    def advance(z: Vector, u: Vector) -> tuple[float, OperatorState]:
        own.state, own.drive[:] = _operators(s, z), drive
        return own.step(float(u[0])), own.state

    return _system(s, advance, "reference", "drive", name)


def inverse_system(model: HysteresisCreepModel, name: str = "inverse") -> control.NonlinearIOSystem:
    """The exact inverse of :func:`model_system`, without limits, as a system from the reference to the drive."""
    return compensator_system(Compensator(model, (-np.inf, np.inf)), name)


def _system(
    s: ModelStructure,
    advance: Callable[[Vector, Vector], tuple[float, OperatorState]],
    input_name: str,
    output_name: str,
    name: str,
) -> control.NonlinearIOSystem:
    """The system of a function from states and input to the output and the operator states after the sample."""

    def update(t: float, z: Vector, u: Vector, params: Mapping[str, Any]) -> Vector:
        return initial_states(s, advance(z, u)[1])

    def output(t: float, z: Vector, u: Vector, params: Mapping[str, Any]) -> Vector:
        return np.array([advance(z, u)[0]])

    states = [f"play[{i}]" for i in range(s.n + 1)]
    states += [f"creep[{rate:g}/s,{i}]" for rate in s.creep_rates for i in range(s.n + 1)]
    return control.nlsys(
        update,
        output,
        inputs=[input_name],
        outputs=[output_name],
        states=[f"{name}_{state}" for state in states],
        dt=s.sample_time,
        name=name,
    )


def main() -> None:
    """Follow a triangle in open loop, with the compensator of an identified model and with a straight line instead."""
    x = multi_sine(duration_s=4.0, sample_time=1e-3, low=0.0, high=150.0)
    y = plants.get("relay_preisach", sample_time=1e-3).run(x)
    s = ModelStructure.equidistant(5, 3, (0.0, 150.0), (float(y.min()), float(y.max())), (), 1e-3)
    actuator, line = identify(x, y, s), HysteresisCreepModel.from_weights(s, s.straight_line)
    y_ref = decaying_triangle(
        duration_s=0.5, sample_time=s.sample_time, low=-12.0, high=12.0, cycles=3, final_share=0.3
    )
    for name, model in (("the model's compensator", actuator), ("a straight line", line)):
        series = control.series(compensator_system(Compensator(model, (0.0, 150.0))), model_system(actuator))
        start = np.concatenate([initial_states(s), initial_states(s)])
        y = control.input_output_response(series, np.arange(y_ref.size) * s.sample_time, y_ref, start).outputs
        print(f"with {name}: RMS error {np.sqrt(np.mean((y - y_ref) ** 2)):.4f} µm")


if __name__ == "__main__":
    main()
