"""(8): x = H⁻¹[S⁻¹[y_r] − K[x]], with the inverses of H and S in closed form and K already updated with the
previous drive."""

import numpy as np
from hypothesis import given
from random_models import FREE, Case, cases

from piezo_model.compensator import Compensator


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
