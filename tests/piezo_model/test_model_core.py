"""The C code of model, data basis and compensator: external calls, warnings, identical bits from every compiler, and
copies."""

import copy
import pickle
import subprocess
from pathlib import Path

import numpy as np
import pytest
from programs import program

from piezo_model import Compensator, DataBasis, HysteresisCreepModel, ModelStructure, core
from piezo_model.core import bindings
from solvers.core import bindings as solvers_bindings
from solvers.core import compile_core

PACKAGE = Path(core.__file__).parents[1]
FOLDERS = compile_core.folders(PACKAGE)
ALGORITHMS = [PACKAGE / "core" / name for name in ("model.c", "data_basis.c", "compensator.c")]
"""Files of an exported folder."""
INCLUDES = [f"-I{folder}" for folder in FOLDERS]
STRUCTURE = ModelStructure.equidistant(
    n=9, m=3, x_range=(0, 150), y_range=(-20, 20), creep_rates=(100, 10, 1), sample_time=1e-3, offset=True
)
SHAPE = "-DCORE_SHAPE={9,7,3,1}"
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

    y, drive, play, creep = (
        np.empty(samples),
        np.empty(samples),
        np.zeros(STRUCTURE.lanes),
        np.zeros(3 * STRUCTURE.lanes),
    )
    bindings.model_simulate(*model.arrays, play, creep, x, y)
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


def test_copies_deep_or_pickled_go_on_by_themselves_with_the_same_bits() -> None:
    x, compensator, basis = np.sin(np.arange(300) / 20), Compensator(a_model()), DataBasis(STRUCTURE)
    compensator.run(10 * x)
    basis.update(75 + 70 * x, 15 * x)
    for duplicate in (copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))):
        one, other = duplicate(compensator), duplicate(compensator)
        one.run(-5 * x)
        np.testing.assert_array_equal(other.run(3 * x), duplicate(compensator).run(3 * x))
        assert not np.array_equal(one.state.play, other.state.play)
        more = duplicate(basis)
        more.update(75 - 70 * x, 10 * x)
        assert (basis.samples, more.samples) == (300, 600)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda block: bindings.basis_update(block, np.zeros(3), np.zeros(2)), "argument 3 has not the shape"),
        (lambda block: bindings.basis_advance(block[:-8].copy(), np.zeros(3)), "not the state"),
        (lambda block: bindings.compensator_run(block, np.zeros(3), np.zeros(3)), "argument 1 is not the state"),
        (lambda block: bindings.basis_setup(block[:1000], 5, 7, 3, 0, 1.0), "has room for 1000 bytes and needs"),
    ],
)
def test_a_state_of_another_kind_and_arrays_that_do_not_fit_are_refused(call, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call(DataBasis(STRUCTURE)._core.block)
