"""A damaged memory of a learner or bank is refused, or the drive stays inside its limits; nothing crashes."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from learning_loops import MODES, sensor, structure_for

from piezo_model import CompensatorBank, DataBasis, SelfLearningCompensator

SCRIPT = """
import sys
import numpy as np
from test_memory_from_outside import restored_or_refused
print(*restored_or_refused(sys.argv[1], int(sys.argv[2])))
"""
HOSTILE = [np.array([value]).view(np.uint8) for value in (-1, 2**31 - 1, 2**62, 7, np.nan, np.inf, 1e300, -1e-300)]


def of_kind(kind: str) -> tuple[SelfLearningCompensator | CompensatorBank, tuple[float, float]]:
    """A learner or bank that has learned for a while, and the limits of its drive."""
    plant = sensor()
    structure = structure_for(plant, n=3, m=1, offset=False)
    y_ref = np.linspace(*plant.y_range, 1500)[np.abs(np.arange(3000) % 400 - 200) * 7]
    if kind == "bank":
        bank = CompensatorBank(structure, 8, hand_over_s=0.05)
        bank.run(np.tile(y_ref[:, None], 8), np.tile(0.9 * y_ref[:, None], 8))
        return bank, plant.x_range
    learner = SelfLearningCompensator(
        structure,
        0.1,
        0.5,
        0.2,
        mode="cyclic" if kind == "cyclic" else "continuous",
        hand_over_s=0.05,
        x_limits=plant.x_range,
        estimate_offset=False,
        adapt_range=False,
    )
    learner.run(y_ref, plant.run)
    return learner, plant.x_range


def restored_or_refused(kind: str, seed: int) -> tuple[int, int]:
    """Numbers of damaged memories that were refused and that ran inside the limits, of 300."""
    random, refused, ran = np.random.default_rng(seed), 0, 0
    one, (low, high) = of_kind(kind)
    good, y_ref = one.get_state(), np.linspace(low, high, 150)
    for _ in range(300):
        damaged = (
            one.get_state()
            if kind == "bank"
            else {**good, "learning": {**good["learning"], "core": good["learning"]["core"].copy()}}
        )
        core = damaged["core"] if kind == "bank" else damaged["learning"]["core"]
        for _ in range(int(random.integers(1, 4))):
            first = 8 * int(random.integers(0, (600 if random.random() < 0.5 else core.size) // 8))
            core[first : first + 8] = HOSTILE[int(random.integers(len(HOSTILE)))]
        try:
            one.restore(damaged)
        except ValueError:
            refused += 1
            continue
        eight = np.tile(y_ref[:, None], 8)
        x = one.run(eight, eight) if isinstance(one, CompensatorBank) else one.replay(y_ref, y_ref)
        if not (np.all(np.isfinite(x)) and x.min() >= low and x.max() <= high):
            raise AssertionError("the drive left its limits")
        ran += 1
        one.restore(good)
    return refused, ran


@pytest.mark.parametrize("kind", [*MODES, "bank"])
def test_a_damaged_memory_is_refused_or_drives_inside_the_limits(kind: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, kind, "0"],
        env={**os.environ, "PYTHONPATH": f"{Path(__file__).parent}:{Path.cwd()}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    refused, ran = map(int, done.stdout.split())
    assert refused > 50
    assert ran > 10


def test_a_second_thread_is_refused_while_the_first_is_at_work() -> None:
    basis, x, errors = DataBasis(structure_for(sensor(), n=30, m=9)), np.sin(np.arange(300_000) / 50.0), []

    def update() -> None:
        try:
            for _ in range(5):
                basis.update(x, x)
        except RuntimeError as error:
            errors.append(str(error))

    threads = [threading.Thread(target=update) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert 1 <= len(errors) <= 2
    assert set(errors) == {"it is in use by another thread; give each thread one of its own"}
    assert basis.samples >= 5 * x.size
