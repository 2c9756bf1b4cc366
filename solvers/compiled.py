"""How hot arithmetic is compiled, entered from Python and given memory.

Four ways to compile a function of arrays and numbers. The only fast-math flag is contraction, never one that assumes NaN and
infinity away, since the guards live on them.

============  ==============================  =========================================================================
``kernel``    as written                      loops over samples, whose bits are those of the C core
``inlined``   as its caller                   steps that become a part of the function that calls them
``compiled``  products fused                  linear algebra: sums are reordered by hand only, so that answers repeat to
                                              the last bit, and 1/0 is inf as in NumPy
``literal``   as written                      error-free transformations, where nothing may be fused
============  ==============================  =========================================================================

``kernel`` and ``inlined`` do without reference counting (``_nrt=False``): otherwise every array taken out of a tuple of parameters is
counted up and down by a call at every sample, which spills the vector registers and doubles the time, and every array
handed in from Python costs 20 ns more. So a kernel allocates nothing and makes no array views.

Compiled code is cached beside its source. The cache of a file is renewed when that file changes, not when a file that
it imports from does: after a change to a step in another file, ``make clean`` removes the caches.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, typeof, types
from numpy.typing import NDArray

kernel = njit(cache=True, _nrt=False)
inlined = njit(cache=True, _nrt=False, inline="always")
compiled = njit(cache=True, fastmath={"contract"}, error_model="numpy")
literal = njit(cache=True, error_model="numpy")


def entry(function: Any, *examples: Any) -> Callable[..., Any]:
    """What a compiled function runs for arguments of the types of these (or for these Numba types), without a look-up of them.

    It saves half of the 0.25 µs that a call from Python costs, and trusts the caller with types and numbers of dimensions.
    """
    signature = tuple(example if isinstance(example, types.Type) else typeof(example) for example in examples)
    function.compile(signature)
    point: Callable[..., Any] = function.overloads[signature].entry_point
    return point


def aligned(rows: int, columns: int) -> NDArray[np.float64]:
    """Zeros, shape (rows, columns), from a cache line on, so that no vector straddles two where columns allows."""
    raw = np.zeros(rows * columns + 8)
    skip = (-raw.ctypes.data // raw.itemsize) % 8
    return raw[skip:skip + rows * columns].reshape(rows, columns)
