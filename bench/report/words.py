"""Formatting of numbers and names, the same in every table, plot and sentence."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from piezo_model.json_file import decoded
from solvers.registry import OURS

MARK = "†"
OURS_NOTE = f"{MARK} ours: written for this project."


def marked(solver: str) -> str:
    """A solver's name, with a mark if it was written for this project.

    Examples
    --------
    >>> marked("daqp"), marked("box_active_set")
    ('daqp', 'box_active_set†')
    """
    return solver + MARK if solver in OURS else solver


def settings_label(settings: str | Mapping[str, Any]) -> str:
    """Turn ``{"steps": 100, "eps": 1.23456e-9}``, or its JSON, into ``steps 100, eps 1.2e-09``."""
    known = decoded(settings, dict[str, Any]) if isinstance(settings, str) else settings
    return ", ".join(
        f"{name} {value:.2g}" if isinstance(value, float) else f"{name} {value}" for name, value in known.items()
    )


def number(value: float) -> str:
    """Three significant digits; from 1000 on, all digits before the decimal point."""
    return "–" if math.isnan(value) else f"{value:.3g}" if abs(value) < 1e3 else f"{value:.0f}"


def rounded(value: float, drift: float) -> str:
    """A time rounded as the drift of the machine requires: three digits below 1 %, two below 10 %, else one.

    Examples
    --------
    >>> [rounded(127.3, drift) for drift in (0.001, 0.05, 0.5)]
    ['127', '130', '100']
    """
    digits = 3 if drift < 0.01 else 2 if drift < 0.1 else 1
    return number(float(f"{value:.{digits - 1}e}"))


def gap(value: float) -> str:
    """A relative cost gap."""
    return "–" if not math.isfinite(value) else f"{value:.1e}"


def percent(share: float) -> str:
    """A relative cost gap in a sentence.

    Examples
    --------
    >>> [percent(share) for share in (0.0, 0.0062, 3.14, 641.2)]
    ['less than 1e-9 %', '0.62 %', '314 %', '641 times']
    """
    if share < 1e-11:
        return "less than 1e-9 %"
    if share >= 10.0:
        return f"{share:.0f} times"
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"{100.0 * share:.0f} %"


def share(value: float) -> str:
    """A share in a table."""
    return "–" if math.isnan(value) else f"{100.0 * value:.3g} %"


def format_distinct(a: float, b: float) -> tuple[str, str]:
    """Two numbers with as many digits, at least three, as are needed to distinguish them.

    Examples
    --------
    >>> format_distinct(0.54312, 0.54309), format_distinct(1.0, 1.0)
    (('0.54312', '0.54309'), ('1', '1'))
    """
    digits = next((n for n in range(3, 17) if a == b or f"{a:.{n}g}" != f"{b:.{n}g}"), 17)
    return f"{a:.{digits}g}", f"{b:.{digits}g}"


def solver_lanes(count: int, of: int | None = None, verb: str = "") -> str:
    """A count of solver lanes, optionally out of a total and with a verb.

    Examples
    --------
    >>> solver_lanes(3), solver_lanes(1, verb="differ"), solver_lanes(1, 4, "reach"), solver_lanes(1, 1, "reach")
    ('3 solver lanes', '1 solver lane differs', '1 of 4 solver lanes reach', '1 of 1 solver lane reaches')
    """
    singular = (count if of is None else of) == 1
    ending = "" if not singular or not verb else "es" if verb.endswith("ch") else "s"
    return (
        f"{count}{'' if of is None else f' of {of}'} solver lane{'' if singular else 's'}{verb and f' {verb}{ending}'}"
    )


def joined(texts: Iterable[str]) -> str:
    """A list in a sentence.

    Examples
    --------
    >>> joined(["a", "b", "c"]), joined(["a"])
    ('a, b and c', 'a')
    """
    items = [*texts]
    return f"{', '.join(items[:-1])} and {items[-1]}" if len(items) > 1 else "".join(items)


def by_heading(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[dict[str, str]]:
    """The rows of a table, each as a dictionary by the headings."""
    return [dict(zip(headings, row, strict=True)) for row in rows]
