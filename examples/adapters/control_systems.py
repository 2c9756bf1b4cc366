"""Model, inverse and compensator as nonlinear discrete-time systems of python-control.

Run alone, it puts a compensator before an actuator.

    z(k+1) = f(z(k), u(k)),   output(k) = g(z(k), u(k))

with the states z of the play and creep operators in unit amplitudes. All three have direct feedthrough: the output at a
sample depends on the input at the same sample. So model and inverse in series are the identity, and a compensator in
front of a plant can be interconnected with it as with any other block; a loop that feeds the plant's output back to the
reference needs a delay somewhere, as any digital controller has.

``control.input_output_response`` interpolates inputs, so one that is not finite reaches the sample after it as well.
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
    """States of the operators as one vector (states,): play of thresholds 0 … r_n, then creep rate by rate; at rest by
    default.

    Examples
    --------
    >>> structure = ModelStructure.equidistant(n=2, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(1.0,),
    ...                                        sample_time=1e-3)
    >>> initial_states(structure).shape
    (6,)
    """
    state = OperatorState.at_rest(structure) if state is None else state
    state.require(structure)
    thresholds, rates = structure.n + 1, len(structure.creep_rates)
    return np.concatenate(
        [state.play[:thresholds], state.creep.reshape(rates, structure.lanes)[:, :thresholds].ravel()]
    )


def _operators(structure: ModelStructure, z: Vector) -> OperatorState:
    """The states (states,) as the kernels take them."""
    play, *creep = z.reshape(-1, structure.n + 1)
    return OperatorState.of(play, creep, structure)


def model_system(model: HysteresisCreepModel, name: str = "actuator") -> control.NonlinearIOSystem:
    """Drive in, displacement out.

    Parameters
    ----------
    model : HysteresisCreepModel
    name : str

    Returns
    -------
    control.NonlinearIOSystem
        With input ``drive``, output ``displacement`` and the time base of the structure; start it from
        :func:`initial_states`.

    Examples
    --------
    >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
    ...                                        sample_time=1e-3)
    >>> model = HysteresisCreepModel.from_weights(structure, [1.0, 2.0])
    >>> system = model_system(model)
    >>> found = control.input_output_response(system, np.arange(3) * 1e-3, [0.0, 1.0, 0.0], initial_states(structure))
    >>> found.outputs.tolist()
    [0.0, 0.75, 0.25]
    """
    s = model.structure

    def moved(z: Vector, u: Vector) -> tuple[float, OperatorState]:
        state = _operators(s, z)
        return float(model.simulate(np.array([u[0]]), state)[0]), state

    return _system(s, moved, "drive", "displacement", name)


def compensator_system(compensator: Compensator, name: str = "compensator") -> control.NonlinearIOSystem:
    """Reference in, drive out, with the model, the limits and the rate limit of a compensator, which is only read.

    A bump of a change of model that is still fading is taken for gone, and so is what integral action has added.
    """
    own = deepcopy(compensator)
    s, drive = own.model.structure, own.drive.copy()
    drive[[BUMP, CORRECTION]] = 0.0

    def moved(z: Vector, u: Vector) -> tuple[float, OperatorState]:
        own.state, own.drive[:] = _operators(s, z), drive
        return own.step(float(u[0])), own.state

    return _system(s, moved, "reference", "drive", name)


def inverse_system(model: HysteresisCreepModel, name: str = "inverse") -> control.NonlinearIOSystem:
    """Reference in, drive out, without any limit: the exact inverse of :func:`model_system`."""
    return compensator_system(Compensator(model), name)


def _system(
    s: ModelStructure,
    moved: Callable[[Vector, Vector], tuple[float, OperatorState]],
    input_name: str,
    output_name: str,
    name: str,
) -> control.NonlinearIOSystem:
    """The system of a step from states and input to the output and the operator states after it."""

    def update(t: float, z: Vector, u: Vector, params: Mapping[str, Any]) -> Vector:
        return initial_states(s, moved(z, u)[1])

    def output(t: float, z: Vector, u: Vector, params: Mapping[str, Any]) -> Vector:
        return np.array([moved(z, u)[0]])

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
    """Follow a triangle, open loop, with the compensator of an identified model and with a straight line in its
    place."""
    x = multi_sine(duration_s=4.0, sample_time=1e-3, low=0.0, high=150.0)
    y = plants.get("relay_preisach", sample_time=1e-3).run(x)
    s = ModelStructure.equidistant(5, 3, (0.0, 150.0), (float(y.min()), float(y.max())), (), 1e-3)
    actuator, line = identify(x, y, s), HysteresisCreepModel.from_weights(s, s.straight_line)
    wanted = decaying_triangle(
        duration_s=0.5, sample_time=s.sample_time, low=-12.0, high=12.0, cycles=3, final_share=0.3
    )
    for what, model in (("the model's compensator", actuator), ("a straight line", line)):
        series = control.series(compensator_system(Compensator(model, (0.0, 150.0))), model_system(actuator))
        start = np.concatenate([initial_states(s), initial_states(s)])
        found = control.input_output_response(series, np.arange(wanted.size) * s.sample_time, wanted, start).outputs
        print(f"along {what}: RMS error {np.sqrt(np.mean((found - wanted) ** 2)):.4f} µm")


if __name__ == "__main__":
    main()
