"""The monotonic clock inside compiled code.

A Python call costs about as much as one solve at d = 18. In the kernel lane a solver is therefore timed from inside: a
compiled loop reads the clock before and after each update and solve. One reading costs some 20 ns and is part of the
figure.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_CLOCK_MONOTONIC = 1
_I32, _I64 = ir.IntType(32), ir.IntType(64)


@intrinsic
def monotonic_ns(typing_context: Any) -> Any:
    """Nanoseconds of POSIX ``clock_gettime(CLOCK_MONOTONIC)``, the clock of ``time.perf_counter_ns`` on Linux."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_I32, [_I32, _I64.as_pointer()])
        function = cgutils.get_or_insert_function(builder.module, kind, "clock_gettime")
        time = cgutils.alloca_once(builder, _I64, size=2)  # struct timespec: seconds, nanoseconds
        builder.call(function, [ir.Constant(_I32, _CLOCK_MONOTONIC), time])
        seconds = builder.load(time)
        nanoseconds = builder.load(builder.gep(time, [ir.Constant(_I32, 1)]))
        return builder.add(builder.mul(seconds, ir.Constant(_I64, 1_000_000_000)), nanoseconds)

    return types.int64(), generate
