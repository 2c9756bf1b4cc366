"""(8): x = H⁻¹[S⁻¹[y_r] − K[x]], with the inverses of H and S in closed form and K already updated with the
previous drive."""

import numpy as np
from hypothesis import given
from plain_model import one_sided_dead_zones
from random_models import FREE, Case, cases

from piezo_model.compensator import Compensator
from piezo_model.inverse import invert_play, invert_superposition
from piezo_model.operators import dead_zone


@given(cases())
def test_the_inverse_of_the_inverse_of_hysteresis_and_of_superposition_is_the_operator_itself(case: Case) -> None:
    for invert, w, r in (
        (invert_play, case.model.w_H, case.structure.thresholds),
        (invert_superposition, case.model.w_S_inverse, np.array(case.structure.dead_zone_thresholds)),
    ):
        for found, expected in zip(invert(*invert(w, r)), (w, r), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


@given(cases())
def test_superposition_after_its_inverse_is_the_identity_in_and_beyond_the_range(case: Case) -> None:
    w, r = case.model.w_S_inverse, np.array(case.structure.dead_zone_thresholds)
    y = np.concatenate([np.linspace(-3, 3, 101), r])
    inverse_w, inverse_r = invert_superposition(w, r)
    np.testing.assert_allclose(dead_zone(one_sided_dead_zones(r, y) @ w, inverse_r) @ inverse_w, y, rtol=0, atol=1e-13)


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
