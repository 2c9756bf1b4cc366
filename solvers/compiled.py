"""How hot arithmetic is compiled.

``kernel`` compiles a function of arrays and numbers. Two things about it matter:

- fast-math flags only as contraction and reassociation, never those that assume NaN and infinity away, since the
  guards live on them;
- no reference counting (``_nrt=False``): otherwise every array taken out of a tuple of parameters is counted up and
  down by a call at every sample, which spills the vector registers and doubles the time. A kernel therefore
  allocates nothing and makes no array views.

``inlined`` is for steps that a kernel calls at every sample with such tuples: they become part of the caller.

Compiled code is cached beside its source. The cache of a file is renewed when that file changes, not when a file that
it imports from does: after a change to a step in another file, ``make clean`` removes the caches.
"""

from __future__ import annotations

from numba import njit

FASTMATH = {"contract", "reassoc"}

kernel = njit(cache=True, fastmath=FASTMATH, _nrt=False)
inlined = njit(cache=True, fastmath=FASTMATH, _nrt=False, inline="always")
