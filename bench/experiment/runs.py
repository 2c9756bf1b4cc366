"""The runs of the experiment by their names, which are those of their lines in every figure, and the colours of
these."""

from bench.report.plot import INK, PALETTE, Axis, Mark, Plot

REFERENCE, STRAIGHT, HINDSIGHT, LEARNED, ONCE = (
    "reference",
    "straight line",
    "best straight line with hindsight",
    "self-learning",
    "learned for 2 cycles, then fixed",
)
BLUE, RED, GREEN, PURPLE = PALETTE[:4]
COLOURS = {REFERENCE: INK, STRAIGHT: RED, HINDSIGHT: GREEN, LEARNED: BLUE, ONCE: PURPLE}
THINNING = 16
"""One sample in so many is drawn: 500 Hz."""


def lines(
    x: Axis, y: Axis, names: tuple[str, ...], where: str = "", along: str = "", points: bool = False, height: int = 240
) -> Plot:
    """One line for each of these names, of those rows of a table for which the words are true."""
    chosen = f"name in {names}" + (f" and {where}" if where else "")
    marks = Mark("line", "name", along=along), *([Mark("point", "name", size=50.0)] if points else [])
    return Plot(x, y, marks, where=chosen, colours={name: COLOURS[name] for name in names}, height=height)
