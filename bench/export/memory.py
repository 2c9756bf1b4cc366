"""How much memory an exported compensator takes: structs as compilers lay them out, constants, stack."""

from __future__ import annotations

from typing import NamedTuple

from bench.export.numbers import Precision
from bench.export.settings import ExportSettings
from piezo_model.structure import ModelStructure


class Layout(NamedTuple):
    """Size of a member or struct of C and its alignment, bytes."""

    size: int
    align: int


INTEGER, WIDE = Layout(4, 4), Layout(8, 8)
REAL: dict[Precision, Layout] = {"double": WIDE, "float": INTEGER}


def padded(count: int, block: int) -> int:
    """Return the next multiple of a block."""
    return -(-count // block) * block


def array(count: int, of: Layout) -> Layout:
    """So many members of a kind."""
    return Layout(count * of.size, of.align)


def struct(*members: Layout) -> Layout:
    """Members one after the other, each at a multiple of its alignment, as compilers lay them out.

    Examples
    --------
    >>> struct(INTEGER, WIDE, INTEGER)
    Layout(size=24, align=8)
    """
    end, align = 0, max(member.align for member in members)
    for member in members:
        end = -(-end // member.align) * member.align + member.size
    return Layout(-(-end // align) * align, align)


def axis_bytes(s: ModelStructure, precision: Precision, learning: bool, cyclic: bool, block: int) -> int:
    """Size of a ``piezo_axis``."""
    play, zones, rates, n = padded(s.n + 1, block), padded(s.dead_zones, block), len(s.creep_rates), s.n + 1
    creep, real = bool(rates), REAL[precision]
    weights = n + s.dead_zones + n * creep + 1
    model = weights + 4 * play + zones + play * creep
    state = play * (1 + rates * (2 if precision == "float" else 1)) + 3
    members = [array(model + state + 5, real)]
    if learning:
        learner = _cyclic_learner(s, real, block) if cyclic else _continuous_learner(s, real, block)
        members += [array(play * creep, real), learner]
    return struct(*members).size


def _cyclic_learner(s: ModelStructure, real: Layout, block: int) -> Layout:
    d, lead, play = s.d, padded(s.d + 1, block), padded(s.n + 1, block)
    return struct(array(4, INTEGER), array(5, real), array(4, INTEGER), array(lead * (1 + 2 * (d + 1)), WIDE),
                  array(4 + play * (3 if s.creep_rates else 1), real), array(lead * (d + 5) + (d + 1) * (d + 2), WIDE), real)


def _continuous_learner(s: ModelStructure, real: Layout, block: int) -> Layout:
    lead, swept = padded(s.d + 1, block), _swept(s, block)
    return struct(array(4, INTEGER), array(5, real), array(13, INTEGER), array(4, real), array(3 * lead + 4, WIDE), swept,
                  array(3, _checkpoint(s, block)))


def _swept(s: ModelStructure, block: int) -> Layout:
    return struct(array(padded(s.d + 1, block) * (2 * (s.d + 1) + 8) + 2, WIDE), array(s.d + 4, INTEGER))


def _checkpoint(s: ModelStructure, block: int) -> Layout:
    return struct(_swept(s, block), array(padded(s.d + 1, block) + 1, WIDE))


def checkpoint_bytes(s: ModelStructure, block: int) -> int:
    """What continuous learning notes to go back to after a fault of the sensor."""
    return _checkpoint(s, block).size


def constant_bytes(s: ModelStructure, precision: Precision, learning: bool) -> int:
    """Thresholds, gains, limits of dead zones and weights."""
    zones = s.dead_zones * (4 if learning else 2)
    return REAL[precision].size * (s.lanes + len(s.creep_rates) + zones + 2 * (s.n + 1) + s.dead_zones + 1)


def stack_bytes(s: ModelStructure, precision: Precision, learning: bool) -> int:
    """More than all frames together need, in steps of 256 bytes."""
    frame = REAL[precision].size * (2 * s.lanes + 24 + 2 * (s.n + 2) + s.dead_zones)
    program = 8 * 4 * (s.d + 8) if learning else 0
    return padded(3 * frame + program + 256, 256)


def figures(s: ModelStructure, settings: ExportSettings) -> dict[str, int]:
    """Bytes of an axis in blocks of eight and without blocks, of a noted state, of constants and stack."""
    precision, learning = settings.precision, settings.learning
    return {"axis": axis_bytes(s, precision, learning, settings.cyclic, block=8),
            "axis_1": axis_bytes(s, precision, learning, settings.cyclic, block=1), "note": checkpoint_bytes(s, block=8),
            "constants": constant_bytes(s, precision, learning), "stack": stack_bytes(s, precision, learning)}
