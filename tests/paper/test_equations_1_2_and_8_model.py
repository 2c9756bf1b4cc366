"""(1): H[x] = Σ w_Hi H_rHi[x], a sum of plays, and S, a sum of one-sided dead zones; (2): y = S[H[x] + K[x]], where
each elementary creep operator is the exact solution of dz/dt = a·dz(x − z, r) for a held input; (8):
x = H⁻¹[S⁻¹[y_r] − K[x]], with the inverses of H and S in closed form and K already updated with the previous drive."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from plain_model import hysteresis_and_creep, one_sided_dead_zones, superposition
from random_models import FREE, Case, cases, drive

from piezo_model.compensator import Compensator
from piezo_model.model import HysteresisCreepModel
from piezo_model.operators import creep, dead_zone, play


@given(*(st.lists(st.floats(-2, 2), min_size=1, max_size=size).map(np.array) for size in (40, 6)))
def test_dead_zones_follow_their_definition(u: np.ndarray, r: np.ndarray) -> None:
    np.testing.assert_array_equal(dead_zone(u, r), one_sided_dead_zones(r, u))


@given(cases())
def test_simulation_is_equation_2_as_plain_numpy_computes_it(case: Case) -> None:
    s, model, z = case.structure, case.model, case.state
    x, size = drive(case.rng, 80), case.structure.n + 1
    H, K = hysteresis_and_creep(s.to_dict(), x, z.play[:size], z.creep.reshape(-1, s.lanes)[:, :size])
    r, rates, outputs = s.thresholds, np.array(s.creep_rates), play(x, s.thresholds, z.play[:size])[0]
    np.testing.assert_array_equal(outputs, H)
    state = z.creep.reshape(-1, s.lanes)[:, :size].ravel()
    crept = creep(x, np.tile(r, rates.size), np.repeat(rates, size), s.sample_time, state)[0]
    np.testing.assert_allclose(crept.reshape(x.size, -1, size).sum(axis=1), K, rtol=0, atol=1e-13)
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


@given(cases())
def test_the_model_after_the_compensator_reproduces_the_reference(case: Case) -> None:
    y_ref = case.reference()
    x = Compensator(case.model, FREE, state=case.state).run(y_ref)
    np.testing.assert_allclose(case.model.simulate(x, case.state), y_ref, rtol=0, atol=case.y_tolerance)


@given(cases())
def test_the_compensator_after_the_model_gives_the_drive_back(case: Case) -> None:
    x = case.a_drive()
    y = case.model.simulate(x, case.state)
    np.testing.assert_allclose(Compensator(case.model, FREE, state=case.state).run(y), x, rtol=0, atol=case.x_tolerance)
