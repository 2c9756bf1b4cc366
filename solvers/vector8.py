"""Eight doubles side by side as one value in compiled code.

A compiler turns a loop over a short array of unknown length into scalar steps with a prologue and an epilogue, and at
d = 18 that is where the time goes. Kernels that are written over blocks of eight instead, with arrays padded to
a multiple of eight, keep their values in registers: one AVX-512, two AVX2 or four NEON registers a block. ``Vector8``
exists inside ``@njit`` functions only:

    v = load8(a, i)        a[i], …, a[i + 7] of a contiguous float64 array; the caller keeps i + 7 inside
    store8(a, i, v)
    v + w, v − w, v * w, v / w, max(v, w), min(v, w)  lane by lane; one side may be a float
    splat8(x)              x in every lane
    sum8(v)                sum of the lanes

Functions written with these operators alone, such as the elementary operators of the model, work on floats and on
vectors from one source. ``max`` and ``min`` return their first argument where one of them is NaN, as on floats.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model
from numba.np.arrayobj import make_array

LANES = 8


class Vector8(types.Type):
    """The Numba type of eight doubles."""

    def __init__(self) -> None:
        super().__init__(name="Vector8")


vector8 = Vector8()
_LLVM = ir.VectorType(ir.DoubleType(), LANES)


@register_model(Vector8)
class _Vector8Model(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _LLVM)


def padded(size: int) -> int:
    """Return the next multiple of eight."""
    return -(-size // LANES) * LANES


def _splat(builder: Any, x: Any) -> Any:
    nothing = ir.Constant(_LLVM, ir.Undefined)
    first = builder.insert_element(nothing, x, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _address(context: Any, builder: Any, array_type: Any, array: Any, index_type: Any, index: Any) -> Any:
    data = make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [context.cast(builder, index, index_type, types.intp)]), _LLVM.as_pointer())


@intrinsic
def load8(typing_context: Any, array: Any, index: Any) -> Any:
    """Eight neighbours of a contiguous float64 array, from ``index`` on; not checked against its length."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = builder.load(_address(context, builder, sig.args[0], args[0], sig.args[1], args[1]))
        value.align = 8
        return value

    return vector8(array, index), generate


@intrinsic
def store8(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Write eight neighbours of a contiguous float64 array, from ``index`` on; not checked against its length."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = builder.store(args[2], _address(context, builder, sig.args[0], args[0], sig.args[1], args[1]))
        place.align = 8
        return context.get_dummy_value()

    return types.void(array, index, vector8), generate


@intrinsic
def splat8(typing_context: Any, x: Any) -> Any:
    """Return x in every lane."""
    return vector8(types.float64), lambda context, builder, sig, args: _splat(builder, args[0])


@intrinsic
def sum8(typing_context: Any, v: Any) -> Any:
    """Sum of the lanes, added pairwise."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        terms = [builder.extract_element(args[0], ir.Constant(ir.IntType(32), lane)) for lane in range(LANES)]
        while len(terms) > 1:
            half = len(terms) // 2
            terms = [builder.fadd(terms[i], terms[i + half]) for i in range(half)]
        return terms[0]

    return types.float64(vector8), generate


def _choose(predicate: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(predicate, b, a), b, a)


def _operator(function: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Teach Numba one lane-by-lane operator on vectors and on a vector and a float."""
    pairs = [(vector8, vector8), (vector8, types.float64), (types.float64, vector8)]

    class Template(ConcreteTemplate):
        cases = [signature(vector8, *pair) for pair in pairs]  # noqa: RUF012 (Numba reads a class attribute)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (_splat(builder, value) if kind == types.float64 else value
                for kind, value in zip(sig.args, args, strict=True))
        return emit(builder, a, b)

    infer_global(function)(Template)
    for pair in pairs:
        lower_builtin(function, *pair)(lower)


_operator(operator.add, lambda builder, a, b: builder.fadd(a, b))
_operator(operator.sub, lambda builder, a, b: builder.fsub(a, b))
_operator(operator.mul, lambda builder, a, b: builder.fmul(a, b))
_operator(operator.truediv, lambda builder, a, b: builder.fdiv(a, b))
_operator(max, _choose(">"))
_operator(min, _choose("<"))
