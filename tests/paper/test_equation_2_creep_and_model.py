"""(2): y = S[H[x] + K[x]], where each elementary creep operator is the exact solution of dz/dt = a·dz(x − z, r) for a
held input."""

import numpy as np
from plain_model import hysteresis_and_creep, superposition
from properties import given, st
from random_models import Case, cases, drive

from piezo_model.model import HysteresisCreepModel
from piezo_model.operators import creep


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0, 1.5), st.floats(0.01, 1e4), st.floats(1e-5, 1e-2))
def test_creep_at_a_held_input_is_the_exact_exponential(x: float, z: float, r: float, rate: float, Ts: float) -> None:
    outputs, last = creep(np.full(50, x), [r], [rate], Ts, [z])
    end = min(max(z, x - r), x + r)  # dz/dt = a·dz(x − z, r) comes to rest at the edge of the band around x
    np.testing.assert_allclose(outputs[:, 0], end + (z - end) * np.exp(-rate * Ts * np.arange(50)), rtol=0, atol=1e-13)
    np.testing.assert_allclose(last, end + (z - end) * np.exp(-rate * Ts * 50), rtol=0, atol=1e-13)


def test_creep_does_not_see_the_input_of_its_own_sample() -> None:
    a, b = (creep([0.0, 0.4, last], [0.0], [50.0], 1e-3, [0.1])[0] for last in (-1.0, 1.0))
    np.testing.assert_array_equal(a, b)


def test_two_short_sampling_periods_of_creep_are_one_long_one() -> None:
    x = np.repeat(np.random.default_rng(0).uniform(-1, 1, 30), 2)
    short, long = creep(x, [0.2], [30.0], 1e-3, [0.5])[0], creep(x[::2], [0.2], [30.0], 2e-3, [0.5])[0]
    np.testing.assert_allclose(short[::2], long, rtol=0, atol=1e-14)


@given(cases())
def test_simulation_is_equation_2_as_plain_numpy_computes_it(case: Case) -> None:
    s, model, z = case.structure, case.model, case.state
    x, size = drive(case.rng, 80), case.structure.n + 1
    H, K = hysteresis_and_creep(s.to_dict(), x, z.play[:size], z.creep.reshape(-1, s.lanes)[:, :size])
    u = H @ model.w_H + model.offset + (K @ model.w_K if s.creep_rates else 0.0)
    expected = s.y_centre + s.y_scale * superposition(s.to_dict(), model.w_S_inverse, u)
    y = model.simulate(s.x_centre + s.x_scale * x, z.copy())
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-11 * s.y_scale + 1e-12 * abs(s.y_centre))


@given(cases())
def test_the_unknowns_of_the_identification_make_the_same_model_when_the_first_weight_is_one(case: Case) -> None:
    again = HysteresisCreepModel.from_weights(case.structure, case.model.weights)
    np.testing.assert_allclose(again.weights, case.model.weights, rtol=1e-15)
    x = case.structure.x_centre + drive(case.rng, 30)  # a common factor in w_H, w_K, offset and S⁻¹ does not show
    np.testing.assert_allclose(
        again.simulate(x, case.state),
        case.model.simulate(x, case.state),
        rtol=0,
        atol=1e-11 * case.structure.y_scale + 1e-12 * abs(case.structure.y_centre),
    )
