"""Eight doubles in a register, so that a kernel says which sums stay out of memory.

LLVM vectorises the loop over the rows of a matrix-vector product but writes the partial sums back after every column;
at d = 18 that costs twice the arithmetic. Here a :data:`Vec8` is a value like a float: ``load`` eight neighbours of an
array, ``fma`` them, ``store`` them. LLVM maps it to one AVX-512, two AVX2 or four SSE2/NEON registers, so the
code runs on any processor that Numba supports and is only tuned for the wide ones.

The operations are Numba intrinsics: they exist inside ``@njit`` functions only, take C-contiguous float64 arrays of two
dimensions and unchecked indices that are not negative, and keep IEEE semantics: a NaN in the first operand of ``vmin``
and ``vmax`` stays a NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped,unused-ignore]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model
from numpy.typing import NDArray

LANES = 8
FASTMATH = {"contract", "reassoc"}
"""Flags of every kernel: sums may be reordered and fused, NaN and infinity keep their meaning."""

_DOUBLE = ir.DoubleType()
_INT = ir.IntType(32)
_V = ir.VectorType(_DOUBLE, LANES)
_UNDEFINED = ir.Constant(_V, ir.Undefined)


class _Vec8(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Vec8")


Vec8 = _Vec8()


@register_model(_Vec8)
class _Vec8Model(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _V)


def _address(context: Any, builder: Any, array_type: Any, array: Any, row: Any, column: Any) -> Any:
    struct = context.make_array(array_type)(context, builder, array)
    width = builder.extract_value(struct.shape, 1)
    return builder.gep(struct.data, [builder.add(builder.mul(row, width, flags=["nsw"]), column, flags=["nsw"])])


def _splat(builder: Any, number: Any) -> Any:
    first = builder.insert_element(_UNDEFINED, number, ir.Constant(_INT, 0))
    return builder.shuffle_vector(first, _UNDEFINED, ir.Constant(ir.VectorType(_INT, LANES), [0] * LANES))


def _elementwise(build: Callable[[Any, Any], Any], count: int) -> Any:
    """Intrinsic on `count` vectors whose code `build(builder, args)` writes."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return build(builder, args)

    if count == 1:
        return intrinsic(lambda typing, a: (Vec8(Vec8), generate))
    if count == 2:
        return intrinsic(lambda typing, a, b: (Vec8(Vec8, Vec8), generate))
    return intrinsic(lambda typing, a, b, c: (Vec8(Vec8, Vec8, Vec8), generate))


def _fma(builder: Any, a: Any, b: Any, c: Any) -> Any:
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_V, [_V] * 3), "llvm.fma.v8f64")
    return builder.call(function, [a, b, c])


def _select(builder: Any, comparison: str, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(comparison, b, a), b, a)


add = _elementwise(lambda builder, args: builder.fadd(*args), 2)
"""a + b."""
sub = _elementwise(lambda builder, args: builder.fsub(*args), 2)
"""a − b."""
mul = _elementwise(lambda builder, args: builder.fmul(*args), 2)
"""a b."""
vmin = _elementwise(lambda builder, args: _select(builder, "<", *args), 2)
"""The smaller of a and b, a where a is a NaN."""
vmax = _elementwise(lambda builder, args: _select(builder, ">", *args), 2)
"""The larger of a and b, a where a is a NaN."""
fma = _elementwise(lambda builder, args: _fma(builder, *args), 3)
"""a b + c, rounded once."""
fnma = _elementwise(lambda builder, args: _fma(builder, builder.fneg(args[0]), args[1], args[2]), 3)
"""c − a b, rounded once."""


@intrinsic
def load(typing: Any, array: Any, row: Any, column: Any) -> Any:
    """array[row, column : column + 8]."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address = _address(context, builder, signature.args[0], *args)
        value = builder.load(builder.bitcast(address, _V.as_pointer()))
        value.align = 8
        return value
    return Vec8(array, types.intp, types.intp), generate


@intrinsic
def store(typing: Any, array: Any, row: Any, column: Any, value: Any) -> Any:
    """array[row, column : column + 8] = value."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address = _address(context, builder, signature.args[0], *args[:3])
        builder.store(args[3], builder.bitcast(address, _V.as_pointer())).align = 8
        return context.get_dummy_value()
    return types.void(array, types.intp, types.intp, Vec8), generate


@intrinsic
def store_columns(typing: Any, array: Any, row: Any, column: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """array[row : row + 8, column : column + 4] = a, b, c, d as columns."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        def shuffle(x: Any, y: Any, lanes: list[int]) -> Any:
            return builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(_INT, len(lanes)), lanes))

        address = _address(context, builder, signature.args[0], *args[:3])
        width = builder.extract_value(context.make_array(signature.args[0])(context, builder, args[0]).shape, 1)
        interleave = [i + LANES * second for i in range(LANES) for second in (0, 1)]
        ab, cd = shuffle(args[3], args[4], interleave), shuffle(args[5], args[6], interleave)
        four = ir.VectorType(_DOUBLE, 4).as_pointer()
        for i in range(LANES):
            row_i = shuffle(ab, cd, [2 * i, 2 * i + 1, 2 * (i + LANES), 2 * (i + LANES) + 1])
            builder.store(row_i, builder.bitcast(address, four)).align = 8
            address = builder.gep(address, [width])
        return context.get_dummy_value()
    return types.void(array, types.intp, types.intp, Vec8, Vec8, Vec8, Vec8), generate


@intrinsic
def splat(typing: Any, number: Any) -> Any:
    """A float in all eight lanes."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _splat(builder, args[0])
    return Vec8(types.float64), generate


@intrinsic
def broadcast(typing: Any, array: Any, row: Any, column: Any) -> Any:
    """array[row, column] in all eight lanes."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _splat(builder, builder.load(_address(context, builder, signature.args[0], *args)))
    return Vec8(array, types.intp, types.intp), generate


@intrinsic
def lane(typing: Any, value: Any, i: Any) -> Any:
    """Lane i of a vector as a float; fast where i is a constant after inlining."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.extract_element(args[0], builder.trunc(args[1], _INT))
    return types.float64(Vec8, types.intp), generate


@intrinsic
def first_lanes(typing: Any, i: Any, a: Any, b: Any) -> Any:
    """The first i lanes of a and the others of b."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        ints = ir.VectorType(_INT, LANES)
        index = builder.insert_element(ir.Constant(ints, ir.Undefined), builder.trunc(args[0], _INT), ir.Constant(_INT, 0))
        index = builder.shuffle_vector(index, ir.Constant(ints, ir.Undefined), ir.Constant(ints, [0] * LANES))
        lanes = ir.Constant(ints, list(range(LANES)))
        return builder.select(builder.icmp_signed("<", lanes, index), args[1], args[2])
    return Vec8(types.intp, Vec8, Vec8), generate


def aligned(rows: int, columns: int) -> NDArray[np.float64]:
    """Zeros, shape (rows, columns), from a cache line on, so that no vector straddles two where columns allows."""
    raw = np.zeros(rows * columns + LANES)
    skip = (-raw.ctypes.data // raw.itemsize) % LANES
    return raw[skip:skip + rows * columns].reshape(rows, columns)


def padded(d: int) -> int:
    """The next multiple of eight that holds d elements."""
    return -(-d // LANES) * LANES
