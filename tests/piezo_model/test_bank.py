"""A bank of compensators, compared with single compensators, single programs and plain NumPy."""

from functools import partial
from pathlib import Path

import box_programs
import numpy as np
import plain_model
import pytest
from command_line import python
from plain_model import Matrix, Vector
from qpsolvers import Problem

from piezo_model import (
    Compensator,
    CompensatorBank,
    Dynamics,
    HysteresisCreepModel,
    ModelError,
    ModelStructure,
    SelfLearningCompensator,
)
from solvers.core import bindings
from solvers.core.compile_core import instruction_sets

STRUCTURE = ModelStructure.equidistant(5, 3, (0.0, 150.0), (-20.0, 20.0), (10.0, 1.0, 0.1), 1.25e-3)
MEMORY_S, RESET_SAMPLES, BLOCK, INTERVAL = 2.0, 80, 20, 80
MIN_SLOPE, PROXIMAL, BELIEF = 0.1, 1e-8, 1e-6


class Actuators:
    """Vectorised actuators: four plays of individual weights, a curved output, and sensor noise."""

    def __init__(self, count: int, seed: int = 1, noise_um: float = 0.004) -> None:
        self.random, self.noise_um = np.random.default_rng(seed), noise_um
        self.r = np.array([0.0, 10.0, 25.0, 50.0])[:, None]
        self.w = self.random.uniform(0.2, 1.0, (4, count))
        self.z = np.full((4, count), 75.0)

    def __call__(self, x: Vector) -> Vector:
        self.z = np.maximum(x - self.r, np.minimum(x + self.r, self.z))
        u = ((self.w * self.z).sum(axis=0) / self.w.sum(axis=0) - 75.0) / 75.0
        return 20.0 * (u + 0.1 * u**2) + self.random.normal(scale=self.noise_um, size=x.size)


def references(samples: int, count: int, seed: int = 0) -> Matrix:
    """Slow sines of changing amplitude, a different one for each actuator."""
    random, k = np.random.default_rng(seed), np.arange(samples)[:, None]
    rate, phase = random.uniform(0.02, 0.05, count), random.uniform(0.0, 6.0, count)
    return np.asarray(15.0 * np.sin(rate * k + phase) * (0.7 + 0.3 * np.sin(0.11 * rate * k)))


def close_loop(bank: CompensatorBank, actuators: Actuators, y_ref: Matrix) -> tuple[Matrix, Matrix]:
    """Drives and measured outputs."""
    x, y, before = np.empty_like(y_ref), np.empty_like(y_ref), np.full(y_ref.shape[1], np.nan)
    for k, row in enumerate(y_ref):
        x[k] = bank.step(row, before)
        y[k] = before = actuators(x[k])
    return x, y


def optimum(gram: Matrix, before: Vector, noise: Vector, held: Vector) -> Vector:
    """The program of core/optimum.c and core/noise.c, (Ξ, x) last, by the exact solver for one program."""
    P, q = gram[:-1, :-1].copy(), gram[:-1, -1].copy()
    rho = PROXIMAL * np.minimum(np.diag(P), np.trace(P) / len(q))
    P, q, lb, share = P + np.diag(rho), q - rho * before, STRUCTURE.lower_bounds(MIN_SLOPE), 1.0
    free = np.diag(P) >= 4.0 * noise
    while np.linalg.eigvalsh((P - (share + 0.02) * np.diag(noise))[np.ix_(free, free)])[0] <= 0.0:
        share *= 0.7
    answer: Vector = held.copy()
    P_free = (P - share * np.diag(noise))[np.ix_(free, free)]
    program = Problem(P_free, q[free] + P[np.ix_(free, ~free)] @ held[~free], lb=lb[free])
    answer[free] = box_programs.optimum(program)
    return answer


def oracle(x: Vector, y: Vector) -> list[Vector]:
    """Unknowns in use after each interval, by the algorithm of bank.h without faults, in plain NumPy."""
    s, d = STRUCTURE.to_dict(), STRUCTURE.d
    x, y = (x - 75.0) / 75.0, y / 20.0
    r = plain_model.thresholds(s)
    rows = np.column_stack([plain_model.rows(s, x, y, r - 1.0, np.tile(r - 1.0, (3, 1))) @ STRUCTURE.slope_map, x])
    forgetting = np.exp(-STRUCTURE.sample_time / MEMORY_S)
    in_use = STRUCTURE.inverse_slope_map @ STRUCTURE.straight_line
    candidate, gram = in_use.copy(), BELIEF * np.eye(d + 1)
    gram[:-1, -1] = gram[-1, :-1] = -BELIEF * np.maximum(in_use, STRUCTURE.lower_bounds(MIN_SLOPE))
    left, errors, found = RESET_SAMPLES, np.zeros(2), []
    piece = 5 + np.digitize(y, [edge for edge in s["dead_zone_thresholds"] if edge != 0.0])
    inner = np.array([*range(5), 6, 7, 8, 8, 8, 9, 10, *range(12, d)])
    n, squares, slopes, recent = np.zeros(d), 0.0, 0.0, [np.nan] * 3
    for begin in range(0, x.size - BLOCK + 1, BLOCK):
        block, p, ended = rows[begin : begin + BLOCK], piece[begin : begin + BLOCK], False
        variance = squares / max(slopes, 1e-30)
        recent = [*recent[-3:], *(block @ np.append(in_use, 1.0))]
        third = np.fmin(np.diff(recent, 3) ** 2 / 20.0, 9.0 * max(variance, 1e-6) * in_use[p] ** 2)
        if left > 0:
            left -= BLOCK
            ended = left <= 0
        else:
            errors += [np.sum((block @ np.append(v, 1.0)) ** 2 - variance * v[p] ** 2) for v in (in_use, candidate)]
            for row, each, square in zip(block, p, third, strict=True):
                gram = forgetting * gram + (1.0 - forgetting) * np.outer(row, row)
                n = forgetting * n + (1.0 - forgetting) * np.eye(d)[each]
                squares = forgetting * squares + (1.0 - forgetting) * square
                slopes = forgetting * slopes + (1.0 - forgetting) * in_use[each] ** 2
        if (begin + BLOCK) % INTERVAL == 0:
            if not ended and left <= 0 and errors.any():
                in_use = candidate if errors[1] <= errors[0] else in_use
                candidate = optimum(gram, candidate, squares / slopes * n, in_use[inner])
            errors[:] = 0.0
            found.append(in_use)
    return found


def test_without_learning_each_drive_is_that_of_a_compensator_to_the_last_bit() -> None:
    random = np.random.default_rng(3)
    models = [
        HysteresisCreepModel(
            STRUCTURE,
            np.r_[random.uniform(0.5, 2.0), random.uniform(0.0, 0.3, 5)],
            np.r_[0.1, 0.2, 0.1, 1.2, 0.2, 0.1, 0.3],
            random.uniform(0.0, 0.1, 6),
            0.0,
        )
        for _ in range(11)
    ]
    y_ref = np.cumsum(random.normal(size=(500, 11)), axis=0)
    y_ref[100, 3], y_ref[200, 4], y_ref[300, 5] = np.nan, np.inf, 1e300
    low, high = np.linspace(0.0, 40.0, 11), np.linspace(100.0, 150.0, 11)
    bank = CompensatorBank(STRUCTURE, 11, (low, high), learn=False, rate_limit=5000.0)
    for i, model in enumerate(models):
        bank.set_model(i, model)
    x = bank.run(y_ref)
    for i, model in enumerate(models):
        single = Compensator(model, (low[i], high[i]), 5000.0)
        np.testing.assert_array_equal(x[:, i], single.run(y_ref[:, i]))
        np.testing.assert_allclose(bank.models[i].simulate(x[:, i]), single.model.simulate(x[:, i]), rtol=0, atol=0)


@pytest.mark.parametrize("noise_um", [0.004, 0.6])
def test_the_weights_of_a_bank_of_one_are_those_of_plain_numpy_that_solves_at_the_same_samples(noise_um: float) -> None:
    bank, plant = CompensatorBank(STRUCTURE, 1), Actuators(1, noise_um=noise_um)
    assert (bank.block, bank.interval) == (BLOCK, INTERVAL)
    y_ref, before = references(1600, 1), np.array([np.nan])
    x, y, weights = np.empty(1600), np.empty(1600), []
    for k in range(1600):
        x[k] = bank.step(y_ref[k], before)[0]
        if k > INTERVAL and k % INTERVAL == BLOCK:  # weights of the interval that ended one block earlier
            weights.append(bank.weights[0, 1:-1])
        y[k : k + 1] = before = plant(x[k : k + 1])
    assert int(bank.counts["hand_overs"][0]) > 5
    expected = [STRUCTURE.slope_map @ unknowns for unknowns in oracle(x, y)[: len(weights)]]
    np.testing.assert_allclose(weights, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("hand_over_s", [0.1, 0.01])
def test_no_sample_has_more_than_its_share_of_blocks_optima_and_checkpoints(hand_over_s: float) -> None:
    bank = CompensatorBank(STRUCTURE, 7000, hand_over_s=hand_over_s)
    offsets, block = bank._core.offsets, bank._core.block
    at, width = offsets["mailbox"][0] + 16, 8 * offsets["driver"][1]  # behind two sizes and the delay
    begins = np.array([block[at + tile * width :][:8].view(np.int64)[0] for tile in range(bank._tiles)])
    for length in (bank.block, bank.interval, int(bank._numbers["checkpoint"])):
        due = np.bincount(begins % length, minlength=length)
        assert due.max() <= due.mean() + 3.0


@pytest.mark.parametrize("threads", [1, 3])
def test_blocks_of_samples_and_threads_change_no_bit(threads: int) -> None:
    y_ref = references(400, 50)
    x, y = close_loop(CompensatorBank(STRUCTURE, 50), Actuators(50), y_ref)
    before = np.vstack([np.full(50, np.nan), y[:-1]])
    bank = CompensatorBank(STRUCTURE, 50, threads=threads)
    pieces = [bank.run(y_ref[part], before[part]) for part in (slice(0, 7), slice(7, 300), slice(300, 400))]
    np.testing.assert_array_equal(np.vstack(pieces), x)


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    CompensatorBank(STRUCTURE, 13).save(tmp_path / "bank.json")
    with pytest.raises(ModelError, match=r"bank\.json: does not hold a whole compensator: there is no field"):
        SelfLearningCompensator.load(tmp_path / "bank.json")


@pytest.mark.parametrize("dynamics", [None, Dynamics((150.0,), (0.05,), (1.0,), 3e-3)])
def test_actuators_are_added_removed_and_given_models_without_any_effect_on_the_others(
    dynamics: Dynamics | None,
) -> None:
    make = partial(CompensatorBank, STRUCTURE, dynamics=dynamics)
    y_ref = references(900, 30)
    x, y = close_loop(make(30), Actuators(30), y_ref)
    before, bank = np.vstack([np.full(30, np.nan), y[:-1]]), make(12)
    np.testing.assert_array_equal(bank.run(y_ref[:101, :12], before[:101, :12]), x[:101, :12])
    bank.set_model([0, 7], bank.models[3])
    kept = np.delete(np.arange(12), [0, 7])
    np.testing.assert_array_equal(bank.run(y_ref[101:200, :12], before[101:200, :12])[:, kept], x[101:200, kept])
    bank.remove([0, 7])
    np.testing.assert_array_equal(bank.run(y_ref[200:500, kept], before[200:500, kept]), x[200:500, kept])
    bank.add(20)
    assert len(bank) == 30
    late = bank.run(
        np.hstack([y_ref[500:, kept], y_ref[500:, 10:]]), np.hstack([before[500:, kept], np.full((400, 20), np.nan)])
    )
    np.testing.assert_array_equal(late, np.hstack([x[500:, kept], make(20).run(y_ref[500:, 10:])]))


@pytest.mark.parametrize("taken", [False, True])
def test_a_model_that_is_set_while_other_weights_are_due_or_blended_in_drives_alone(taken: bool) -> None:
    bank, plant, before, y_ref = (
        CompensatorBank(STRUCTURE, 1, blend_time_s=0.05),
        Actuators(1),
        np.array([np.nan]),
        iter(references(1600, 1)),
    )
    while bank.counts["hand_overs"] == 0 or (taken and np.all(bank.models[0].weights == STRUCTURE.straight_line)):
        before = plant(bank.step(next(y_ref), before))
    model = HysteresisCreepModel.from_weights(STRUCTURE, 1.5 * STRUCTURE.straight_line)
    bank.set_model(0, model)
    np.testing.assert_array_equal(bank.run(np.zeros((BLOCK + 1, 1)))[:, 0], Compensator(model).run(np.zeros(BLOCK + 1)))
    np.testing.assert_array_equal(bank.weights, [model.all_weights])


def test_learning_is_switched_off_and_on_for_each() -> None:
    y_ref, plant = references(1200, 10), Actuators(10)
    bank = CompensatorBank(STRUCTURE, 10, learn=np.arange(10) % 2 == 0)
    close_loop(bank, plant, y_ref)
    assert np.array_equal(bank.counts["hand_overs"] > 0, bank.learning)
    np.testing.assert_array_equal(bank.weights[1::2], CompensatorBank(STRUCTURE, 5).weights)
    before, odd = bank.counts["hand_overs"], np.arange(10) % 2 == 1
    bank.learning = odd
    close_loop(bank, plant, y_ref)
    np.testing.assert_array_equal(bank.counts["hand_overs"] > before, odd)


def test_one_that_pauses_goes_on_alike_whether_the_others_paused_or_not() -> None:
    drives, y_ref = [], references(1330, 2)
    for others in (True, False):
        bank, plant, parts = CompensatorBank(STRUCTURE, 2), Actuators(2), []
        for learns, part in zip((True, False, True), np.split(y_ref, [500, 730]), strict=True):
            bank.learning = [learns, learns or others]
            parts.append(close_loop(bank, plant, part)[0][:, 0])
        drives.append(np.concatenate(parts))
    np.testing.assert_array_equal(*drives)


SCRIPT = """
import hashlib
from test_bank import STRUCTURE, Actuators, CompensatorBank, close_loop, references
bank = CompensatorBank(STRUCTURE, 9, hand_over_s=0.02)
x, _ = close_loop(bank, Actuators(9), references(500, 9))
assert bank.counts["hand_overs"].min() > 0
print(hashlib.sha256(x.tobytes()).hexdigest())
"""


@pytest.mark.skipif(len(instruction_sets()) == 1, reason="this kind of machine has one instruction set")
def test_every_instruction_set_gives_the_same_bits() -> None:
    here = [each for each in instruction_sets() if int(each[1:]) <= bindings.processor_level()]
    extremes = here[:: max(1, len(here) - 1)]  # the least and the largest; test_core compares all
    assert len({python("-c", SCRIPT, PIEZOBENCH_ISA=each).stdout for each in extremes}) == 1
