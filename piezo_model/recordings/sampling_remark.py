"""The sampling period where a file states it in so many words: "Sample rate [Hz]: 2000", "dt = 1e-4"."""

import re
from collections.abc import Iterable, Mapping

from numpy.typing import NDArray

from piezo_model.units import canonical, seconds

_RATE = r"(?:sampl\w*|acquisition|scan|daq|data)[\s_-]*(?:rate|freq\w*)|fs|rate[\s_-]*hz|samples per second|abtastrate"
_PERIOD = (
    r"sampl\w*[\s_-]*(?:time|period|interval|dt)|dt|ts|delta[\s_-]*t(?:ime)?|time[\s_-]*(?:step|increment)|"
    r"wf_increment|delta_x|abtastzeit"
)
_STATED = re.compile(
    rf"(?<![^\W_])(?P<key>(?P<rate>{_RATE})|(?P<period>{_PERIOD}))(?![^\W_])"
    r"\s*(?:[\[(](?P<before>[^\])]*)[\])])?[\"']?\s*[:=,;\t ]\s*"
    r"(?P<value>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(?P<after>[^\W\d]+(?:/s)?)?",
    re.IGNORECASE,
)
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "s/s": 1.0, "sps": 1.0, "": 1.0}


def sample_time_in(lines: Iterable[str]) -> float | None:
    """Sampling period in seconds that remarks state, or None where none or more than one does.

    >>> heads = ["Operator: K", "# Sampling rate (kHz) = 20"], ["dt: 5 ms"], ["t;u;y"]
    >>> [sample_time_in(head) for head in heads]
    [5e-05, 0.005, None]
    """
    found = {_period(match) for line in lines for match in _STATED.finditer(line)} - {None}
    return found.pop() if len(found) == 1 else None


def sample_time_in_scalars(arrays: Mapping[str, NDArray]) -> float | None:
    """Sampling period in seconds that numbers among arrays state by their names, or by the last part of these."""
    return sample_time_in(
        f"{name.rpartition('/')[2]} = {float(array.ravel()[0])!r}"
        for name, array in arrays.items()
        if array.size == 1 and array.dtype.kind in "iuf"
    )


def _period(match: re.Match[str]) -> float | None:
    value, unit = float(match["value"].replace(",", ".")), (match["before"] or match["after"] or "").strip()
    if not 0.0 < value < 1e12:
        return None
    if match["rate"]:
        hertz = _HERTZ.get(unit.lower())
        return None if hertz is None else 1.0 / (value * hertz)
    per = seconds(canonical(unit)) if canonical(unit) or not unit else None
    return None if per is None else value * per
