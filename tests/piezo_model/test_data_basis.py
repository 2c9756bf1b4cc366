"""The data basis, in chunks of any size, and the problem made of it: units, weights that the drive does not excite, and
the proximal term."""

import tracemalloc
from dataclasses import replace
from functools import partial

import known_models
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_models import basis_of, true_model, undisplaced
from random_models import Case, cases

from piezo_model import DataBasis, IdentificationProblem, ModelStructure
from piezo_model.identification.error_model import ProgramSolver

structure = partial(known_models.structure, n=4, m=2, sample_time=1e-2)


def problem_of(
    s: ModelStructure,
    x: np.ndarray,
    noise: float = 0.0,
    rest: float = 0.0,
    reference: np.ndarray | None = None,
    proximal: float = 1e-10,
) -> IdentificationProblem:
    """Problem of a drive in normalised units, answered by :func:`true_model`."""
    x_V, state = s.x_centre + s.x_scale * x, undisplaced(s, rest)
    y = true_model(s).simulate(x_V, state) + noise * s.y_scale * np.random.default_rng(3).normal(size=x.size)
    return basis_of(s, x_V, y, state).problem(reference, proximal=proximal)


def full_drive(amplitude: float = 1.0, size: int = 3000) -> np.ndarray:
    k = np.arange(size)
    return amplitude * (0.6 * np.sin(k / 15) + 0.4 * np.sin(k / 47))


def test_raw_variables_have_physical_units() -> None:
    s = structure()
    problem = problem_of(s, full_drive())
    w, unit = ProgramSolver().optimum(problem), np.ones(s.d)
    unit[s.slices[1]], unit[-1] = s.x_scale / s.y_scale, s.x_scale  # V/µm, and V for the offset
    np.testing.assert_allclose(problem.form("weight", "raw").variables(w), unit * w)


# Weights that the drive does not excite.


def unreached(problem: IdentificationProblem) -> set[str]:
    return set(problem.excitation_report().unreached)


@pytest.mark.parametrize("rest", [0.0, 0.3])
@pytest.mark.parametrize("amplitude", [0.15, 0.35, 0.55, 0.75, 0.95])
def test_the_report_names_exactly_the_thresholds_that_the_drive_did_not_reach(amplitude: float, rest: float) -> None:
    s = structure()
    x = rest + full_drive(amplitude) / np.max(np.abs(full_drive()))
    y = s.unit_output(true_model(s).simulate(s.x_centre + s.x_scale * x, undisplaced(s, rest)))
    expected = {f"w_{letter}{i}" for letter in "HK" for i, r in enumerate((0.0, *s.play_thresholds)) if r > amplitude}
    expected |= {
        name
        for name, r in zip(s.weight_names[s.n :], s.dead_zone_thresholds, strict=False)
        if (r > 0 and y.max() <= r) or (r < 0 and y.min() >= r)
    }
    assert unreached(problem_of(s, x, rest=rest)) == expected


def test_a_monotone_drive_from_a_known_state_reaches_the_operators_that_it_moves() -> None:
    names = unreached(problem_of(structure(creep_rates=()), np.linspace(0.0, 0.7, 500)))
    assert names & {"w_H1", "w_H2", "w_H3", "w_H4"} == {"w_H4"}


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("rest", [0.0, 0.3])
def test_unreached_weights_stay_at_the_reference_for_any_data(noise: float, rest: float) -> None:
    s = structure()
    reference = s.slope_map @ np.linspace(0.2, 0.9, s.d)
    problem = problem_of(s, rest + full_drive(0.25), noise, rest, reference)
    away = np.abs(s.inverse_slope_map @ (ProgramSolver().optimum(problem) - reference))
    held = np.array([name in unreached(problem) for name in s.weight_names])
    assert held.sum() >= 6
    assert np.all(away[held] <= 1e-12)
    assert np.all(away[~held] > 1e-6)


def test_a_direction_that_the_data_leave_open_shows_in_the_condition() -> None:
    # y never comes back to the piece around zero, so what that piece adds is one more constant beside the offset.
    s = structure(creep_rates=())
    report, full = (
        problem_of(s, x, rest=rest).excitation_report()
        for x, rest in ((0.85 + full_drive(0.1), 0.85), (full_drive(), 0.0))
    )
    assert full.unreached == ()
    assert full.condition < 1e6 < report.condition <= 1 / np.finfo(float).eps


def test_a_drive_that_stands_still_names_everything_open_and_still_has_a_finite_condition() -> None:
    s = structure(creep_rates=(), offset=False)
    still = replace(problem_of(s, full_drive()), P=np.zeros((s.d, s.d)), q=np.zeros(s.d), c=0.0)
    assert still.excitation_report().unreached == s.weight_names
    assert np.isfinite(still.excitation_report().condition)


BLOCK = 64
"""Number of rows per update."""


@settings(max_examples=60)
@given(cases(), st.integers(1, 5 * BLOCK), st.sampled_from([1.0, 0.999, 0.99, 0.9, 0.3]))
def test_P_q_and_c_are_those_of_a_dense_computation_and_any_chunks_and_missing_outputs_change_no_bit(
    case: Case, size: int, forgetting: float
) -> None:
    x, y = case.recording(size)
    counted = case.rng.random(x.size) < 0.9
    counted[:BLOCK], counted[-7:] = case.rng.random() < 0.5, True
    whole, parts = (DataBasis(case.structure, case.state, forgetting) for _ in range(2))
    out = case.structure.unit_output(y[counted])
    whole.update(x, np.where(counted, y, np.nan))
    cuts = np.union1d(np.flatnonzero(np.diff(counted)) + 1, case.rng.integers(0, x.size, 9))
    for a, b, count in zip(np.split(x, cuts), np.split(y, cuts), np.split(counted, cuts), strict=True):
        parts.update(a, b, count=bool(count.all()) if count.size else False)
        if parts.samples:
            parts.problem()  # reading the basis midway changes nothing
    for name in ("P", "q", "c", "samples", "excitation"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    np.testing.assert_equal(vars(parts.state), vars(whole.state))
    assert whole.samples == out.size
    assert (whole.excitation.y_min, whole.excitation.y_max) == (out.min(), out.max())
    P, q, c = case.program(x, y, counted, forgetting)
    assert np.max(np.abs(whole.P - P) / (np.sqrt(np.outer(np.diag(P), np.diag(P))) + 1e-3)) < 1e-12
    np.testing.assert_allclose(whole.q, q, rtol=0, atol=1e-12 * (1 + np.abs(P).max()))
    assert whole.c == pytest.approx(c, rel=1e-12)
    np.testing.assert_array_equal(whole.P, whole.P.T)


@pytest.mark.parametrize("offset", [False, True])
def test_memory_does_not_grow_with_the_recording(offset: bool) -> None:
    s = ModelStructure.equidistant(
        n=20, m=8, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(9.0, 3.0), sample_time=1e-2, offset=offset
    )
    x, basis = np.sin(np.arange(2000) / 20), DataBasis(s)
    basis.update(x, x)
    peaks = []
    tracemalloc.start()
    for chunks in (5, 95):
        for _ in range(chunks):
            basis.update(x, x)
        peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    assert peaks[1] - peaks[0] < 0.1 * 95 * 2 * x.nbytes  # a tenth of the additional samples
    assert basis.samples == 101 * 2000


SMALL = ModelStructure.equidistant(n=2, m=1, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(1.0,), sample_time=1e-2)


@pytest.mark.parametrize(
    ("x", "y", "sentence"),
    [
        ([1.0, 2.0], [1.0], r"same length, not of shapes \(2,\) and \(1,\)"),
        ([[1.0]], [[1.0]], r"vectors of the same length, not of shapes \(1, 1\)"),
        ([1.0, np.nan, 2.0], [1.0, 1.0, 1.0], r"x\[1\] is not a finite number"),
        ([1.0, 1.0], [1.0, -np.inf], r"y\[1\] is not a finite number"),
    ],
)
@pytest.mark.parametrize("count", [True, False])
def test_bad_samples_are_refused_in_one_sentence_and_nothing_is_taken(
    x: list, y: list, sentence: str, count: bool
) -> None:
    basis, other = (basis_of(SMALL, [0.3, 0.9], [0.1, 0.2]) for _ in range(2))
    with pytest.raises(ValueError, match=sentence):
        basis.update(x, y, count=count)
    np.testing.assert_equal((basis.P, basis.state.play), (other.P, other.state.play))
