"""Rows of matrices as vectors of eight doubles, for kernels that say which sums stay out of memory.

LLVM vectorises the loop over the rows of a matrix-vector product but writes the partial sums back after every column,
which doubles the time at d = 18. Here they are values of :mod:`solvers.vector8`, and this file adds what dense
linear algebra wants: eight neighbours of a row of a matrix, one entry in all lanes, a product and a sum rounded once.

These are Numba intrinsics: they exist inside compiled functions only and take C-contiguous float64 matrices whose rows
are padded to a multiple of eight, and unchecked indices that are not negative.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, typeof, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from solvers.vector8 import LANES, vector8

compiled = njit(cache=True, fastmath={"contract"}, error_model="numpy")
"""How every function here is compiled: a product and a sum may be rounded once, NaN and infinity keep their meaning (sums are
reordered by hand only, so that answers repeat to the last bit), and 1/0 is inf as in NumPy."""

literal = njit(cache=True, error_model="numpy")
"""For error-free transformations: nothing may be fused."""

_INT = ir.IntType(32)
_V = ir.VectorType(ir.DoubleType(), LANES)


def _lanes(numbers: list[int]) -> Any:
    return ir.Constant(ir.VectorType(_INT, len(numbers)), numbers)


def _address(context: Any, builder: Any, array_type: Any, array: Any, row: Any, column: Any) -> Any:
    struct = context.make_array(array_type)(context, builder, array)
    width = builder.extract_value(struct.shape, 1)
    return builder.gep(struct.data, [builder.add(builder.mul(row, width, flags=["nsw"]), column, flags=["nsw"])])


def _fused(builder: Any, a: Any, b: Any, c: Any) -> Any:
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_V, [_V] * 3), "llvm.fma.v8f64")
    return builder.call(function, [a, b, c])


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""
    return vector8(vector8, vector8, vector8), lambda context, builder, signature, args: _fused(builder, *args)


@intrinsic
def fnma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """c − a b, rounded once."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _fused(builder, builder.fneg(args[0]), args[1], args[2])
    return vector8(vector8, vector8, vector8), generate


@intrinsic
def load(typing: Any, array: Any, row: Any, column: Any) -> Any:
    """array[row, column : column + 8]."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address = _address(context, builder, signature.args[0], *args)
        value = builder.load(builder.bitcast(address, _V.as_pointer()))
        value.align = 8
        return value
    return vector8(array, types.intp, types.intp), generate


@intrinsic
def store(typing: Any, array: Any, row: Any, column: Any, value: Any) -> Any:
    """array[row, column : column + 8] = value."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address = _address(context, builder, signature.args[0], *args[:3])
        builder.store(args[3], builder.bitcast(address, _V.as_pointer())).align = 8
        return context.get_dummy_value()
    return types.void(array, types.intp, types.intp, vector8), generate


@intrinsic
def store_columns(typing: Any, array: Any, row: Any, column: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """array[row : row + 8, column : column + 4] = a, b, c, d as columns."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        def shuffle(x: Any, y: Any, lanes: list[int]) -> Any:
            return builder.shuffle_vector(x, y, _lanes(lanes))

        address = _address(context, builder, signature.args[0], *args[:3])
        width = builder.extract_value(context.make_array(signature.args[0])(context, builder, args[0]).shape, 1)
        interleave = [i + LANES * second for i in range(LANES) for second in (0, 1)]
        ab, cd = shuffle(args[3], args[4], interleave), shuffle(args[5], args[6], interleave)
        four = ir.VectorType(ir.DoubleType(), 4).as_pointer()
        for i in range(LANES):
            row_i = shuffle(ab, cd, [2 * i, 2 * i + 1, 2 * (i + LANES), 2 * (i + LANES) + 1])
            builder.store(row_i, builder.bitcast(address, four)).align = 8
            address = builder.gep(address, [width])
        return context.get_dummy_value()
    return types.void(array, types.intp, types.intp, vector8, vector8, vector8, vector8), generate


@intrinsic
def broadcast(typing: Any, array: Any, row: Any, column: Any) -> Any:
    """array[row, column] in all eight lanes."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        number = builder.load(_address(context, builder, signature.args[0], *args))
        first = builder.insert_element(ir.Constant(_V, ir.Undefined), number, ir.Constant(_INT, 0))
        return builder.shuffle_vector(first, ir.Constant(_V, ir.Undefined), _lanes([0] * LANES))
    return vector8(array, types.intp, types.intp), generate


@intrinsic
def lane(typing: Any, value: Any, i: Any) -> Any:
    """Lane i of a vector as a float; fast where i is a constant after inlining."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.extract_element(args[0], builder.trunc(args[1], _INT))
    return types.float64(vector8, types.intp), generate


@intrinsic
def first_lanes(typing: Any, i: Any, a: Any, b: Any) -> Any:
    """The first i lanes of a and the others of b."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        nothing = ir.Constant(ir.VectorType(_INT, LANES), ir.Undefined)
        count = builder.insert_element(nothing, builder.trunc(args[0], _INT), ir.Constant(_INT, 0))
        count = builder.shuffle_vector(count, nothing, _lanes([0] * LANES))
        return builder.select(builder.icmp_signed("<", _lanes(list(range(LANES))), count), args[1], args[2])
    return vector8(types.intp, vector8, vector8), generate


def entry(function: Any, *examples: Any) -> Callable[..., Any]:
    """What a compiled function runs for arguments of the types of these, without Numba's look-up of the types.

    It saves 0.13 µs of the 0.25 µs that a call from Python costs, and trusts the caller with the types.
    """
    signature = tuple(typeof(example) for example in examples)
    function.compile(signature)
    compiled: Callable[..., Any] = function.overloads[signature].entry_point
    return compiled


def aligned(rows: int, columns: int) -> NDArray[np.float64]:
    """Zeros, shape (rows, columns), from a cache line on, so that no vector straddles two where columns allows."""
    raw = np.zeros(rows * columns + LANES)
    skip = (-raw.ctypes.data // raw.itemsize) % LANES
    return raw[skip:skip + rows * columns].reshape(rows, columns)
