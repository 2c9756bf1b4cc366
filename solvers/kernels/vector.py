"""Rows of matrices as vectors of eight doubles, for kernels that say which sums stay out of memory.

LLVM vectorises the loop over the rows of a matrix-vector product but writes the partial sums back after every column,
which doubles the time at d = 18. Here they are values of :mod:`solvers.vector8`, and this file adds what dense
linear algebra wants: eight neighbours of a row of a matrix, one entry in all lanes, a product and a sum rounded once.

These are Numba intrinsics: they exist inside compiled functions only and take C-contiguous float64 matrices whose rows
are padded to a multiple of eight, and unchecked indices that are not negative.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from solvers.vector8 import LANES, vector8

_INT = ir.IntType(32)
_V = ir.VectorType(ir.DoubleType(), LANES)


def _lanes(numbers: list[int]) -> Any:
    return ir.Constant(ir.VectorType(_INT, len(numbers)), numbers)


def _address(context: Any, builder: Any, array_type: Any, array: Any, row: Any, column: Any) -> Any:
    struct = context.make_array(array_type)(context, builder, array)
    width = builder.extract_value(struct.shape, 1)
    return builder.gep(struct.data, [builder.add(builder.mul(row, width, flags=["nsw"]), column, flags=["nsw"])])


def _numbers() -> Any:
    return ir.Constant(ir.VectorType(ir.IntType(64), LANES), list(range(LANES)))


def _in_all_lanes(builder: Any, number: Any) -> Any:
    nothing = ir.Constant(ir.VectorType(number.type, LANES), ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(_INT, 0))
    return builder.shuffle_vector(first, nothing, _lanes([0] * LANES))


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
        return _in_all_lanes(builder, builder.load(_address(context, builder, signature.args[0], *args)))
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
        return builder.select(builder.icmp_signed("<", _numbers(), _in_all_lanes(builder, args[0])), args[1], args[2])
    return vector8(types.intp, vector8, vector8), generate


@intrinsic
def load_first(typing: Any, array: Any, row: Any, column: Any, count: Any) -> Any:
    """array[row, column : column + count] and zeros in the other lanes, whose memory is not read."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        address = builder.bitcast(_address(context, builder, signature.args[0], *args[:3]), _V.as_pointer())
        mask = builder.icmp_signed("<", _numbers(), _in_all_lanes(builder, args[3]))
        kind = ir.FunctionType(_V, [_V.as_pointer(), _INT, mask.type, _V])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.masked.load.v8f64.p0")
        return builder.call(function, [address, ir.Constant(_INT, 8), mask, ir.Constant(_V, [0.0] * LANES)])
    return vector8(array, types.intp, types.intp, types.intp), generate


@intrinsic
def with_lane(typing: Any, value: Any, i: Any, number: Any) -> Any:
    """The vector with a float in lane i; as it was where there is no lane i."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        mask = builder.icmp_signed("==", _numbers(), _in_all_lanes(builder, args[1]))
        return builder.select(mask, _in_all_lanes(builder, args[2]), args[0])
    return vector8(vector8, types.intp, types.float64), generate


@intrinsic
def max8(typing: Any, value: Any) -> Any:
    """Largest lane."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        value, size = args[0], LANES
        while size > 1:
            size //= 2
            nothing = ir.Constant(value.type, ir.Undefined)
            low = builder.shuffle_vector(value, nothing, _lanes(list(range(size))))
            high = builder.shuffle_vector(value, nothing, _lanes(list(range(size, 2 * size))))
            value = builder.select(builder.fcmp_ordered(">", high, low), high, low)
        return builder.extract_element(value, ir.Constant(_INT, 0))
    return types.float64(vector8), generate


@intrinsic
def first_equal8(typing: Any, value: Any, number: Any) -> Any:
    """The first lane that equals a float; 8 where none does."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        same = builder.fcmp_ordered("==", args[0], _in_all_lanes(builder, args[1]))
        bits = builder.zext(builder.bitcast(same, ir.IntType(LANES)), ir.IntType(64))
        bits = builder.or_(bits, ir.Constant(ir.IntType(64), 1 << LANES))
        return builder.cttz(bits, ir.Constant(ir.IntType(1), 1))
    return types.intp(vector8, types.float64), generate


@intrinsic
def root_scale8(typing: Any, value: Any) -> Any:
    """2^−⌊e/2⌋ for v = m 2^e with m ∈ [½, 1), lane by lane; nonsense where v is not a positive normal number."""
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        integers = ir.VectorType(ir.IntType(64), LANES)

        def every(number: int) -> Any:
            return ir.Constant(integers, [number] * LANES)

        exponent = builder.sub(builder.lshr(builder.bitcast(args[0], integers), every(52)), every(1022))
        half = builder.sub(every(1023), builder.ashr(exponent, every(1)))
        return builder.bitcast(builder.shl(half, every(52)), _V)
    return vector8(vector8), generate
