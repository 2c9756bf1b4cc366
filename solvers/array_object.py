"""NumPy arrays as Python hands them over, looked at inside compiled code.

A compiled function called by its :func:`solvers.compiled.entry` trusts its caller with what its arguments are, and to look at
``P.dtype`` and ``P.ndim`` of two arrays in Python takes 0.1 µs, a tenth of a solve at d = 18. So an argument may be an
:data:`array_object`, any Python object at all, which

    matrix(x, NDARRAY), vector(x, NDARRAY)        a C-contiguous float64 array, empty where x is anything else

turn into an array or refuse in a few instructions. What they read is the head of two C structs (NumPy reference, "Python types
and C-structures"): of ``PyArrayObject_fields`` the data, number of dimensions, dimensions, strides, base, dtype and flags, of
``PyArray_Descr`` the class, kind, type and byte order letters, flags and type number.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import NativeValue, intrinsic, models, register_model, unbox
from numba.np.arrayobj import make_array, populate_array

NDARRAY = id(np.ndarray)
"""Where this process has the class of arrays; compiled code outlives the process and is handed it."""

_CHAR, _INT, _WORD, _POINTER = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.IntType(8).as_pointer()
_HEAD = object.__basicsize__
_CLASS, _DATA, _NDIM, _SHAPE, _DTYPE, _FLAGS = _HEAD - 8, _HEAD, _HEAD + 8, _HEAD + 16, _HEAD + 40, _HEAD + 48
_BYTE_ORDER, _TYPE_NUMBER = _HEAD + 10, _HEAD + 12
_C_CONTIGUOUS_AND_ALIGNED = 0x101


class ArrayObject(types.Opaque):
    """The Numba type of a Python object that may be an array; borrowed for the time of the call."""

    def __init__(self) -> None:
        super().__init__(name="ArrayObject")


array_object = ArrayObject()
register_model(ArrayObject)(models.OpaqueModel)


@unbox(ArrayObject)
def _unbox(kind: Any, argument: Any, context: Any) -> Any:
    return NativeValue(argument)


def _array(ndim: int) -> Any:
    array = types.Array(types.float64, ndim, "C")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        argument, array_class = args

        def field(struct: Any, place: int, kind: Any) -> Any:
            address = builder.gep(struct, [ir.Constant(_WORD, place)])
            return builder.load(builder.bitcast(address, kind.as_pointer()))

        def equal(value: Any, expected: int) -> Any:
            return builder.icmp_signed("==", value, ir.Constant(value.type, expected))

        result = make_array(array)(context, builder)  # zeros
        with builder.if_then(builder.icmp_signed("==", field(argument, _CLASS, _WORD), array_class), likely=True):
            dtype = field(argument, _DTYPE, _POINTER)
            flags = builder.and_(field(argument, _FLAGS, _INT), ir.Constant(_INT, _C_CONTIGUOUS_AND_ALIGNED))
            fits = equal(field(argument, _NDIM, _INT), ndim)
            for condition in (equal(field(dtype, _TYPE_NUMBER, _INT), np.dtype(np.float64).num), equal(flags, _C_CONTIGUOUS_AND_ALIGNED),
                              equal(field(dtype, _BYTE_ORDER, _CHAR), ord("="))):
                fits = builder.and_(fits, condition)
            with builder.if_then(fits, likely=True):
                extents = field(argument, _SHAPE, _WORD.as_pointer())
                shape = [builder.load(builder.gep(extents, [ir.Constant(_WORD, i)])) for i in range(ndim)]
                itemsize = ir.Constant(_WORD, 8)
                strides = [builder.mul(itemsize, shape[1]), itemsize] if ndim == 2 else [itemsize]
                populate_array(result, field(argument, _DATA, ir.DoubleType().as_pointer()), shape, strides,
                               itemsize, meminfo=None)
        return result._getvalue()

    return array(array_object, types.intp), generate


@intrinsic
def matrix(typing: Any, argument: Any, array_class: Any) -> Any:
    """The array that an argument is; shape (0, 0) where it is no C-contiguous float64 matrix.

    Examples
    --------
    >>> from numba import njit
    >>> from solvers.compiled import entry
    >>> rows = entry(njit(lambda x, array_class: matrix(x, array_class).shape[0]), array_object, NDARRAY)
    >>> rows(np.eye(3), NDARRAY), rows(np.eye(3)[:, :2], NDARRAY), rows("no array", NDARRAY)
    (3, 0, 0)
    """
    return _array(2)


@intrinsic
def vector(typing: Any, argument: Any, array_class: Any) -> Any:
    """The array that an argument is; shape (0,) where it is no contiguous float64 vector."""
    return _array(1)
