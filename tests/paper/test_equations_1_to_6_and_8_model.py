"""(1): H[x] = Σ w_Hi H_rHi[x], a sum of plays, and S, a sum of one-sided dead zones; (2): y = S[H[x] + K[x]], where
each elementary creep operator is the exact solution of dz/dt = a·dz(x − z, r) for a held input; (8):
x = H⁻¹[S⁻¹[y_r] − K[x]], with the inverses of H and S in closed form and K already updated with the previous drive.

(3) and (5): the output error of (2) is not linear in the weights; E = x + Σ w_H H[x] + Σ w_K K[x] − Σ w'_S S[y] is.
(4): V(w) = ½ wᵀP w + qᵀw + c, the mean square of the error (5) over the samples, accumulated as they arrive. (6): the
weights minimise it among those of invertible models: a box in the slopes of S⁻¹, a cone in its weights."""

from itertools import product
from typing import get_args

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from known_models import a_drive, basis_of, structure, true_model
from plain_model import hysteresis_and_creep, one_sided_dead_zones, superposition
from random_models import FREE, Case, cases, drive

from piezo_model import (
    Compensator,
    HysteresisCreepModel,
    ModelStructure,
    OperatorState,
    identify,
)
from piezo_model.identification_problem import Coordinates, Scaling
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


def test_the_papers_case_has_eighteen_unknowns_in_the_papers_order() -> None:
    s = ModelStructure.equidistant(
        n=5, m=3, x_range=(0.0, 150.0), y_range=(-20.0, 20.0), creep_rates=(10.0, 1.0), sample_time=125e-6
    )
    assert s.d == 18
    assert s.weight_names == (
        "w_H1",
        "w_H2",
        "w_H3",
        "w_H4",
        "w_H5",
        "w'_S-3",
        "w'_S-2",
        "w'_S-1",
        "w'_S0",
        "w'_S1",
        "w'_S2",
        "w'_S3",
        "w_K0",
        "w_K1",
        "w_K2",
        "w_K3",
        "w_K4",
        "w_K5",
    )
    np.testing.assert_allclose(s.play_thresholds, np.arange(1, 6) / 6)
    np.testing.assert_allclose(s.dead_zone_thresholds, np.arange(-3, 4) / 4)


FORMS = list(product(get_args(Coordinates), get_args(Scaling)))


@given(cases(), st.integers(0, 2**32 - 1))
def test_slopes_are_the_derivative_of_the_inverse_superposition_between_thresholds(case: Case, seed: int) -> None:
    s = case.structure
    w, r = np.random.default_rng(seed).normal(size=s.d), np.array(s.dead_zone_thresholds)
    v, w_S = s.inverse_slope_map @ w, s.slices[1]
    middles = np.concatenate([[r[0] - 0.1], 0.5 * (r[1:] + r[:-1]), [r[-1] + 0.1]])
    low, high = np.where(r > 0, -np.inf, r), np.where(r < 0, np.inf, r)
    inside = (middles[:, None] < low) | (middles[:, None] > high)
    expected = np.insert(v[w_S], s.middle, v[w_S][s.middle])  # the slope at zero holds on both sides of it
    np.testing.assert_allclose(inside @ w[w_S], expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(s.slope_map @ v, w, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(np.delete(v, w_S), np.delete(w, w_S))
    np.testing.assert_allclose(
        case.model.slopes / case.model.w_H[0], (s.inverse_slope_map @ case.model.weights)[w_S], rtol=1e-12
    )


@settings(max_examples=40)
@given(cases(), st.sampled_from(FORMS))
def test_every_form_has_the_cost_of_the_error_model_and_the_proximal_term(
    case: Case, form: tuple[Coordinates, Scaling]
) -> None:
    s, rng = case.structure, case.rng
    basis = basis_of(s, *case.recording(300), case.state)
    reference, w = rng.uniform(0, 1, s.d), rng.uniform(0, 1, s.d)
    problem = basis.problem(reference, proximal=1e-4)
    v, v_ref = s.inverse_slope_map @ w, s.inverse_slope_map @ reference
    acting = s.slope_map @ np.where(problem.reached, v, v_ref)  # the data see unreached weights at their reference
    rho = 1e-4 * np.mean(np.diag(s.slope_map.T @ problem.P @ s.slope_map))
    expected = problem.cost(acting) + 0.5 * rho * np.sum((v - v_ref) ** 2)
    f = problem.form(*form)
    z = f.variables(w)
    unit = s.x_scale**2 if form[1] == "raw" else 1.0
    assert 0.5 * z @ f.qp.P @ z + f.qp.q @ z + f.c == pytest.approx(unit * expected, rel=1e-9, abs=1e-9 * unit)
    np.testing.assert_allclose(f.weights(z), w, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(f.qp.P, f.qp.P.T)
    if form[1] == "scaled":
        np.testing.assert_array_equal(np.diag(f.qp.P), np.ones(s.d))


@settings(max_examples=40)
@given(cases(), st.integers(0, 2**32 - 1))
def test_box_and_cone_admit_the_same_weights(case: Case, seed: int) -> None:
    s = case.structure
    problem = basis_of(s, *case.recording(200), case.state).problem(min_slope=0.05)
    v = np.random.default_rng(seed).uniform(-0.02, 1, s.d)
    assume(np.min(np.abs(v - s.lower_bounds(0.05))) > 1e-6)
    admissible = bool(np.all(v >= s.lower_bounds(0.05)))
    for form in FORMS:
        f = problem.form(*form)
        z = f.variables(s.slope_map @ v)
        inside = bool(np.all(z >= f.qp.lb)) and (f.qp.G is None or bool(np.all(f.qp.G @ z <= f.qp.h)))
        assert inside == admissible


@pytest.mark.parametrize("offset", [False, True])
@pytest.mark.parametrize("rates", [(), (1.0,), (10.0, 1.0, 0.1)])
def test_the_weights_of_a_model_in_the_class_are_recovered(offset: bool, rates: tuple[float, ...]) -> None:
    s = structure(offset=offset, creep_rates=rates)
    truth, state, x = true_model(s), OperatorState.settled_at(s, s.x_centre + 0.2 * s.x_scale), a_drive()
    model = identify(x, truth.simulate(x, state), s, state=state, proximal=1e-14)
    np.testing.assert_allclose(model.weights, truth.weights, rtol=0, atol=1e-7)
    assert model.report["fit"]["skipped"] == 0
    assert max(model.report["certificate"]["cost_gap"], model.report["lag"]["samples"]) < 1e-9
    assert "shows no significant lag" in " ".join(model.report["sentences"])
    assert identify(x, truth.simulate(x, state), s, state=state).report["fit"]["max_percent"] < 1e-4
