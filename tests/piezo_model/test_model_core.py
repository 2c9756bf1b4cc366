"""The C code of model, data basis and compensator: external calls, warnings, identical bits from every compiler, and
copies."""

import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from command_line import python
from faulty_sensor import FaultySensor
from learning_loops import MODES, sensor, structure_for
from numpy.typing import NDArray
from programs import program

from piezo_model import (
    Compensator,
    CompensatorBank,
    DataBasis,
    HysteresisCreepModel,
    ModelStructure,
    SelfLearningCompensator,
    core,
    plants,
)
from piezo_model.core import bindings
from solvers.core import bindings as solvers_bindings
from solvers.core import compile_core

PACKAGE = Path(core.__file__).parents[1]
FOLDERS = compile_core.folders(PACKAGE)
ALGORITHMS = [PACKAGE / "core" / name for name in ("model.c", "prefilter.c", "data_basis.c", "compensator.c")]
"""Files of an exported folder."""
INCLUDES = [f"-I{folder}" for folder in FOLDERS]
STRUCTURE = ModelStructure.equidistant(
    n=9, m=3, x_range=(0, 150), y_range=(-20, 20), creep_rates=(100, 10, 1), sample_time=1e-3, offset=True
)
SHAPE = "-DCORE_SHAPE={.n=9,.zones=7,.rates=3,.offset=1}"
MAIN = """
#include "compensator.h"
#include "data_basis.h"
#include "model.h"
#include <stdio.h>

static _Alignas(64) char basis[1 << 20], compensator[1 << 16];
static double model[MODEL], x[SAMPLES], y[SAMPLES], play[64], creep[256];

int main(void)
{
    const size_t sizes[] = {SIZES};
    Basis b;
    Compensator c;
    if (fread(model, 1, sizeof model, stdin) + fread(basis, 1, sizes[0], stdin)
        + fread(compensator, 1, sizes[1], stdin) + fread(x, 1, sizeof x, stdin)
        != sizeof model + sizes[0] + sizes[1] + sizeof x) {
        return 1;
    }
    b = basis_at(basis);
    c = compensator_at(compensator);
    const int k = lanes(c.shape), zones = zone_lanes(c.shape);
    double *const a = model + k, *const low = a + c.shape.rates, *const high = low + zones, *const w_S = high + zones;
    double *const w_H = w_S + zones, *const w_K = w_H + k;
    const Model m = {c.shape, {model, a}, low, high, w_S, w_H, w_K, model[MODEL - 1]};
    model_simulate(&m, x, SAMPLES, play, creep, y);
    for (int k = 0; k < SAMPLES; ++k) {
        basis_count(&b, x[k], y[k]);
        y[k] = compensator_step(&c, y[k], NULL);
        if (k == SAMPLES / 2) {
            const int n = c.shape.n + 1, zones = c.shape.zones; /* without padding */
            double weights[64];
            memcpy(weights, c.inverse.w_H, (size_t)n * sizeof *weights);
            memcpy(weights + n, c.inverse.w_S, (size_t)zones * sizeof *weights);
            memcpy(weights + n + zones, c.inverse.w_K, (size_t)n * sizeof *weights);
            weights[2 * n + zones] = 2 * c.inverse.offset[0];
            compensator_set_weights(&c, weights);
        }
    }
    fwrite(y, 1, sizeof y, stdout);
    fwrite(basis, 1, sizes[0], stdout);
    fwrite(compensator, 1, sizes[1], stdout);
    return 0;
}
"""


def a_model() -> HysteresisCreepModel:
    rng = np.random.default_rng(0)
    return HysteresisCreepModel.from_weights(STRUCTURE, STRUCTURE.slope_map @ rng.uniform(0.1, 1.0, STRUCTURE.d))


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_every_compiler_level_and_instruction_set_gives_the_bits_that_python_gives(
    compiler: str, tmp_path: Path
) -> None:
    model, samples = a_model(), 1000
    x = np.sin(np.arange(samples) / 30) * np.cos(np.arange(samples) / 170)
    basis, compensator = DataBasis(STRUCTURE, forgetting=0.999), Compensator(model, (0.0, 150.0), rate_limit=5e4)
    states, arrays = (basis._core, compensator._core), np.hstack(model.arrays)
    given = b"".join([arrays.tobytes(), *(state.block.tobytes() for state in states), x.tobytes()])
    sizes = ",".join(str(state.block.size) for state in states)

    y, drive = np.empty(samples), np.empty(samples)
    bindings.model_simulate(*model.arrays, np.zeros(STRUCTURE.lanes), np.zeros(3 * STRUCTURE.lanes), x, y)
    bindings.basis_update(basis._core.block, x, y)
    for k in range(samples):
        drive[k] = bindings.compensator_step(compensator._core.block, float(y[k]))
        if k == samples // 2:
            weights = compensator.model.all_weights.copy()
            weights[-1] *= 2.0
            bindings.compensator_set_weights(compensator._core.block, weights)
    expected = drive.tobytes() + basis._core.block.tobytes() + compensator._core.block.tobytes()

    source, target = tmp_path / "main.c", tmp_path / "program"
    source.write_text(MAIN, encoding="utf-8")
    words = [f"-DSAMPLES={samples}", f"-DSIZES={sizes}", f"-DMODEL={arrays.size}"]
    sets = [f"-march=x86-64-v{level}" for level in range(2, solvers_bindings.processor_level() + 1)] or ["-DCORE_PLAIN"]
    for options in [
        ["-O0", sets[-1]],
        ["-O1", sets[-1], SHAPE],
        *(["-O2", each] for each in sets),
        ["-O3", sets[-1], SHAPE],
        ["-O3", "-DCORE_PLAIN"],
    ]:
        subprocess.run(
            [
                program(compiler),
                "-std=c11",
                "-ffp-contract=off",
                *options,
                *words,
                *INCLUDES,
                str(source),
                *map(str, ALGORITHMS),
                "-o",
                str(target),
                "-lm",
            ],
            check=True,
        )
        got = subprocess.run([target], input=given, stdout=subprocess.PIPE, check=True).stdout
        assert got == expected, options


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda block: bindings.basis_update(block, np.zeros(3), np.zeros(2)), "argument 3: expected"),
        (lambda block: bindings.basis_finish(block[:-8].copy()), "not the state"),
        (lambda block: bindings.compensator_run(block, np.zeros(3), np.zeros(3)), "argument 1 is not the state"),
        (lambda block: bindings.basis_setup(block[:1000], 5, 7, 3, 0, 1.0), "has room for 1000 bytes and needs"),
    ],
)
def test_a_state_of_another_kind_and_arrays_that_do_not_fit_are_refused(call, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call(DataBasis(STRUCTURE)._core.block)


Vector = NDArray[np.float64]
T = 1e-3
SAMPLES, COUNT = 12_000, 8
"""One tile, which starts at the same sample as a single learner."""
REVERSED = 4
"""Its actuator whose output falls as the input rises."""


def recorded(plant: plants.Plant, faulty: bool) -> tuple[Vector, Vector]:
    """References and measured outputs of eight actuators, some with failing sensors."""
    t, number = np.arange(SAMPLES)[:, None] * T, np.arange(COUNT)
    y_range, x_range = np.array(plant.y_range), np.array(plant.x_range)
    wave = 0.9 * np.sin(2 * np.pi * (1.3 + 0.2 * number) * t) * np.cos(2 * np.pi * 0.11 * t)
    y = np.empty_like(wave)
    for i in range(COUNT):
        actuator = plants.Sensor(plants.get("relay_preisach", sample_time=T), noise_um=2e-4 * np.ptp(y_range), seed=i)
        measure = FaultySensor(actuator, seed=i) if faulty and i % 2 else actuator.run
        y[:, i] = measure(x_range.mean() + 0.45 * np.ptp(x_range) * wave[:, i])
    return y_range.mean() + 0.5 * np.ptp(y_range) * wave, y


@pytest.mark.sample(4)
@pytest.mark.parametrize("faulty", [False, True])
@pytest.mark.parametrize("integral_gain", [0.0, 50.0])
@pytest.mark.parametrize(("n", "m", "offset"), [(5, 3, False), (9, 2, True)])
def test_each_lane_drives_and_learns_like_a_single_compensator_to_the_last_bit(
    faulty: bool, integral_gain: float, n: int, m: int, offset: bool, tmp_path: Path
) -> None:
    plant = plants.get("relay_preisach", sample_time=T)
    structure = ModelStructure.equidistant(n, m, plant.x_range, plant.y_range, (100.0, 10.0, 1.0), T, offset=offset)
    y_ref, y = recorded(plant, faulty)
    y[:, REVERSED] = sum(plant.y_range) - y[:, REVERSED]
    before = np.vstack([np.full(COUNT, np.nan), y[:-1]])
    options = {"hand_over_s": 0.1, "integral_gain": integral_gain, "rate_limit": 3e4}
    x_start = np.linspace(0.0, 150.0, COUNT)
    bank = CompensatorBank(structure, COUNT, x_start=x_start, **options)
    middle = SAMPLES // 2 + 7
    x = bank.run(y_ref[:middle], before[:middle])
    bank.save(tmp_path / "bank.npz")
    bank = CompensatorBank.load(tmp_path / "bank.npz")
    x = np.vstack([x, bank.run(y_ref[middle:], before[middle:])])
    for i in range(COUNT):
        single = SelfLearningCompensator(
            structure,
            mode="continuous",
            estimate_offset=False,
            adapt_range=False,
            x_start=x_start[i],
            **options,
        )
        assert single._block == bank.block
        np.testing.assert_array_equal(single.replay(y_ref[:, i], before[:, i]), x[:, i])
        assert {name: counts[i] for name, counts in bank.counts.items()} == {
            name: single._memory[name] for name in bank.counts
        }
        assert (single.counts["hand_overs"] > 5) == (i != REVERSED)
        assert (single.counts["reversed"] > 0) == (i == REVERSED)
        assert (single._memory["faults"] > 0) == (faulty and i % 2 == 1)


SCRIPT = """
import sys
import numpy as np
from test_model_core import restored_or_refused
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
    refused, ran = map(int, python("-c", SCRIPT, kind, 0).stdout.split())
    assert refused > 50
    assert ran > 10


def test_a_second_thread_is_refused_while_the_first_is_at_work() -> None:
    basis, x = DataBasis(structure_for(sensor(), n=30, m=9)), np.sin(np.arange(300_000) / 50.0)

    def update() -> str:
        try:
            for _ in range(5):
                basis.update(x, x)
        except RuntimeError as error:
            return str(error)
        return ""

    with ThreadPoolExecutor(3) as pool:
        said = [each.result() for each in [pool.submit(update) for _ in range(3)]]
    assert 1 <= said.count("") <= 2
    assert {*said} == {"", "it is in use by another thread; give each thread one of its own"}
    assert basis.samples >= 5 * x.size
