"""(3) and (5): the output error of (2) is not linear in the weights; E = x + Σ w_H H[x] + Σ w_K K[x] − Σ w'_S S[y]
is."""

import numpy as np
from properties import given, settings
from random_models import Case, cases, drive

from piezo_model.data_basis import DataBasis
from piezo_model.structure import ModelStructure


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


@settings(max_examples=30)
@given(cases())
def test_the_error_model_vanishes_at_the_weights_that_made_the_data(case: Case) -> None:
    s = case.structure
    x = s.x_centre + s.x_scale * drive(case.rng, 200)
    y = case.model.simulate(x, case.state)
    basis = DataBasis(s, case.state)
    basis.update(x, y)
    problem = basis.problem()
    size = 1 + np.abs(case.model.weights) @ np.abs(problem.P) @ np.abs(case.model.weights)
    assert abs(problem.cost(case.model.weights)) < 1e-13 * size
