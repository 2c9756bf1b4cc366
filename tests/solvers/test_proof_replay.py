"""Replaying a proof: any change of it or of the data is detected, and JSON preserves it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from every_active_set import corner, gram_problem
from qpsolvers import Problem

from solvers.certificate import Certificate, NotCertified, certify, exact_cost_gap, verify


@pytest.mark.parametrize(
    ("line", "change"),
    [
        (r"1 \(problem\)", {"problem": "0" * 64}),
        (r"2 \(convexity\)", {"convexity_shift": 2.0**-60}),
        (r"3 \(stationarity\)", {"lower": (1, 1)}),
        (r"3 \(stationarity\)", {"lower": (7,)}),
        (r"3 \(stationarity\)", {"upper": (1,)}),
        (r"4 \(feasibility\)", {"lower": ()}),
        (r"5 \(signs\)", {"lower": (0, 1)}),
        (r"5 \(signs\)", {"pinned": (0,)}),
        (r"6 \(value\)", {"value": "-1000000000000000000000000000001/1000000000000000000000000000000"}),
        (r"7 \(answer\)", {"value_rounded": -1.0000000000000002}),
        (r"7 \(answer\)", {"x": (1.0000000000000002, 0.0)}),
        (r"7 \(answer\)", {"unique": False}),
    ],
)
def test_a_perturbed_certificate_fails_at_the_line_that_is_wrong(line: str, change: dict) -> None:
    proof = certify(corner, np.zeros(2))
    with pytest.raises(NotCertified, match=f"proof line {line} fails"):
        verify(corner, replace(proof, **change))


def test_moving_any_variable_in_or_out_of_the_active_set_is_noticed() -> None:
    problem = gram_problem(18, seed=18)
    proof = certify(problem, np.zeros(18))
    for member in range(18):
        with pytest.raises(NotCertified, match=r"proof line [45]"):
            verify(problem, replace(proof, lower=tuple(sorted(set(proof.lower) ^ {member}))))


def test_the_certificate_fails_for_data_that_differ_in_one_bit() -> None:
    proof, P, q = certify(corner, np.zeros(2)), corner.P.copy(), np.nextafter(corner.q, 0)
    P[1, 1] = np.nextafter(P[1, 1], np.inf)
    for nudged in (Problem(corner.P, q, lb=corner.lb, ub=corner.ub), Problem(P, corner.q, lb=corner.lb, ub=corner.ub)):
        with pytest.raises(NotCertified, match=r"proof line 1 .* other data"):
            verify(nudged, proof)
        with pytest.raises(NotCertified, match="other data"):
            exact_cost_gap(nudged, proof, np.zeros(2))


def test_a_certificate_survives_the_round_trip_through_json() -> None:
    rng = np.random.default_rng(5)
    couplings = np.tril(rng.normal(size=(60, 60)), -1) * 2.0**-200  # far below the diagonal: many digits
    P = np.diag(rng.uniform(1, 2, 60)) + couplings + couplings.T
    problem = Problem(P, rng.normal(size=60), lb=np.full(60, -9.0))
    proof = certify(problem, np.zeros(60))
    assert len(proof.value) > 2 * 4300  # longer integers than Python reads by default
    again = Certificate.from_json(proof.to_json())
    assert again == proof
    verify(problem, again)
    assert exact_cost_gap(problem, again, np.array(again.x)).absolute >= 0


@pytest.mark.parametrize("text", ["", "[]", "{}", json.dumps({"x": [1.0]})])
def test_text_that_is_no_certificate_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a certificate"):
        Certificate.from_json(text)
