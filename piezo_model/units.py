"""Units: parsed from column names, stored in ASCII ("um"), shown as engineers write them ("37.9 µm").

Common units are in a table; others are parsed by pint, which takes half a second to import.
"""

import math
import re
from collections.abc import Mapping
from functools import cache
from typing import Any

SECONDS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
VOLTAGES = ("V", "mV", "kV", "uV")
LENGTHS = ("um", "nm", "mm", "pm", "m")
ANGLES = ("rad", "mrad", "urad", "deg")
UNITS = frozenset((*SECONDS, *VOLTAGES, *LENGTHS, *ANGLES, "A", "mA", "N", "mN"))
"""Units that are recognised as a bare suffix; in brackets every unit is."""
_PREFIXES = {"n": "nano", "u": "micro", "m": "milli", "k": "kilo", "p": "pico", "c": "centi", "": ""}
_WORDS = {
    "V": ("volt", "volts"),
    "m": ("meter", "meters", "metre", "metres"),
    "s": ("second", "seconds", "sec", "secs"),
    "A": ("ampere", "amperes", "amp", "amps"),
    "N": ("newton", "newtons"),
    "rad": ("radian", "radians"),
}
SPELLINGS: Mapping[str, str] = {
    **{
        long + word: short + unit
        for short, long in _PREFIXES.items()
        for unit, words in _WORDS.items()
        for word in words
    },
    "v": "V",
    "UM": "um",
    "NM": "nm",
    "mv": "mV",
    "kv": "kV",
    "micron": "um",
    "microns": "um",
    "mum": "um",
    "msec": "ms",
    "usec": "us",
    "nsec": "ns",
    "minute": "min",
    "minutes": "min",
    "hour": "h",
    "hours": "h",
    "hr": "h",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "counts": "counts",
    "count": "counts",
    "cts": "counts",
    "a.u.": "a.u.",
    "au": "a.u.",
    "%": "%",
    "degC": "degC",
    "°C": "degC",
    "Hz": "Hz",
    "kHz": "kHz",
    "MHz": "MHz",
    "inch": "inch",
}
NO_UNITS = frozenset(
    {
        "act",
        "in",
        "am",
        "no",
        "as",
        "piezo",
        "measured",
        "sensor",
        "raw",
        "out",
        "input",
        "output",
        "drive",
        "actual",
        "desired",
        "target",
        "set",
        "ref",
        "reference",
        "filtered",
        "closed",
        "open",
        "cmd",
        "command",
        "smoothed",
    }
)
"""Words in brackets that are not units, although pint parses some of them."""
PREFIXED = ("rad", "V", "m", "s", "A", "N")
PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3}
_PREFIX_OF = {factor: prefix for prefix, factor in PREFIXES.items()}
_LENGTH, _SPEED = (
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        r"displ|position|travel|height|stroke|deflection|elongation|extension|distance|length",
        r"[\s_]([nmuk]?(rad|m|V)|deg)/(m|u|n)?s$",
    )
)
"""Names of quantities measured in inches, and units of a speed, in which the seconds are not a unit of time."""
LONGEST_NAME, LONGEST_UNIT = 200, 40
"""Most characters of a column name in which a unit is looked for, and of a unit that is parsed by pint."""
_FACTOR = r"[^\W\d][\w°]*(?:(?:\^|\*\*)-?\d)?"
COMPOUND = re.compile(rf"{_FACTOR}(?:[*/·]{_FACTOR})*")
"""Units with one-digit exponents; pint would compute large powers of numbers in a file for hours."""
SMALLEST_PERCENT = 1e-4
"""Percentages below this are rounding errors, whose digits mean nothing."""
SHOWN = {"deg": "°", "degC": "°C", "angstrom": "Å", "percent": "%"}


class UnitError(ValueError):
    """A unit of another quantity than expected; the message is a sentence."""


def split_unit(column: str) -> tuple[str, str]:
    """Stem and unit of a column name; the unit is "" if the name has none, and µ is written u.

    >>> split_unit("displacement_um"), split_unit("Weg [µm]"), split_unit("U in V"), split_unit("height (piezo)")
    (('displacement', 'um'), ('Weg', 'um'), ('U', 'V'), ('height (piezo)', ''))
    >>> split_unit("travel (in)"), split_unit("voltage (in)"), split_unit("omega_rad/s"), split_unit("t/s")
    (('travel', 'inch'), ('voltage (in)', ''), ('omega_rad/s', ''), ('t', 's'))
    """
    plain = _ascii(column)
    if len(plain) > LONGEST_NAME:
        return plain, ""
    for bracketed in reversed(list(re.finditer(r"[\s_]*[\[(]([^\[\]()]*)[\])]", plain))):
        # (in) is inches of a length, and else an input
        if (
            unit := "inch"
            if bracketed[1] == "in" and _LENGTH.search(plain[: bracketed.start()])
            else canonical(bracketed[1])
        ):
            return (plain[: bracketed.start()] + plain[bracketed.end() :]).strip(), unit
    suffixed = re.fullmatch(r"(.+?)\s*(?:[_/,\s]|\sin\s)\s*([^\W_]+)", plain)
    if suffixed and not _SPEED.search(plain):
        unit = SPELLINGS.get(suffixed[2], suffixed[2])
        if unit in UNITS:
            return re.sub(r"\s+in$", "", suffixed[1]), unit
    return plain, ""


def canonical(text: str) -> str:
    """The stored form of a unit, or "" for a text that is not a unit.

    >>> canonical("µm"), canonical("Volts"), canonical("kV/cm"), canonical("piezo")
    ('um', 'V', 'kV/cm', '')
    """
    plain = _ascii(text).strip("[]() ")
    for spelling in (plain, plain.lower()):
        if spelling in UNITS:
            return spelling
        if spelling in SPELLINGS:
            return SPELLINGS[spelling]
    if not 2 <= len(plain) <= LONGEST_UNIT or plain.lower() in NO_UNITS or not COMPOUND.fullmatch(plain):
        return ""
    return "" if (unit := _parsed(plain)) is None else _ascii(f"{unit:~C}")


def seconds(unit: str) -> float | None:
    """Seconds in one unit of time, or None for another unit; no unit means seconds.

    >>> seconds("ms"), seconds("d"), seconds("um")
    (0.001, 86400.0, None)
    """
    if unit in SECONDS or not unit:
        return SECONDS[unit or "s"]
    registry = _registry()
    return float(registry(unit).to("s").magnitude) if registry.is_compatible_with(unit, "s") else None


def conversion(name: str, role: str, unit: str, to: str) -> tuple[float, str]:
    """Factor from the unit of a signal to another, and a clause if this changes values or one unit is unknown.

    With an unknown unit, "", the values are kept. A unit that pint does not know, such as digits, is compatible only
    with itself.

    Raises
    ------
    UnitError
        The units measure different quantities; the message names the file, the role and both units.

    Examples
    --------
    >>> conversion("stage.csv", "output", "nm", "µm")
    (0.001, 'the output is converted from nm to µm')
    >>> conversion("stage.csv", "output", "um", "µm")
    (1.0, '')
    >>> conversion("stage.csv", "output", "", "um")
    (1.0, 'the output is taken as it is, since only one unit is known (µm)')
    """
    own, other = (canonical(text) or text.strip() for text in (unit, to))
    if own == other:
        return 1.0, ""
    if not (own and other):
        return 1.0, f"the {role} is taken as it is, since only one unit is known ({shown(own or other)})"
    (factor, root), (other_factor, other_root) = (
        (1.0, text) if (parsed := _parsed(text)) is None else _registry().get_root_units(parsed)
        for text in (own, other)
    )
    if str(root) != str(other_root) or _registry().convert(0.0, own, other):  # of °C and K, the zeros differ
        raise UnitError(
            f"{name}: the {role} is in {shown(own)}, which cannot be converted to {shown(other)}; name another column, "
            "or the unit that the values are really in"
        )
    return float(f"{factor / other_factor:.15g}"), f"the {role} is converted from {shown(own)} to {shown(other)}"


def shown(unit: str) -> str:
    """A unit as engineers write it.

    >>> shown("um"), shown("V"), shown("deg")
    ('µm', 'V', '°')
    """
    return SHOWN.get(unit) or re.sub(r"\bu(?=[a-zA-Z])", "µ", unit)


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A value with its unit, and a prefix that avoids powers of ten.

    >>> quantity(3.79e-5, "m"), quantity(1790.0, ""), quantity(0.005, "s"), quantity(-73.6357, "um")
    ('37.9 µm', '1790', '5 ms', '-73.64 µm')
    """
    base = next((base for base in PREFIXED if unit.endswith(base) and unit.removesuffix(base) in PREFIXES), None)
    if base and value and math.isfinite(value):
        factor = PREFIXES[unit.removesuffix(base)]
        if not 0.1 <= abs(value) < 1e4:
            factor = max(
                (f for f in PREFIXES.values() if f <= max(abs(value * factor), 1e-9) and (f <= 1.0 or base in "VN")),
                default=factor,
            )
        value, unit = value * PREFIXES[unit.removesuffix(base)] / factor, _PREFIX_OF[factor] + base
    number = f"{value:.{digits}g}"
    if "e" in number and 1e-4 <= abs(value) < 1e7:
        number = f"{float(number):.0f}"
    return f"{number} {shown(unit)}".rstrip()


def percent(value: float) -> str:
    """A percentage with two digits."""
    if abs(value) > 100.0:
        return "over 100 %" if value > 0.0 else "under −100 %"
    return f"{value:.2g} %" if abs(value) >= SMALLEST_PERCENT else "less than 0.0001 %"


def _ascii(text: str) -> str:
    return text.replace("µ", "u").replace("μ", "u").strip()


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


@cache
def _parsed(text: str) -> Any:
    """The unit of pint, or None for a text that is not one."""
    import pint

    try:
        return _registry().parse_units(text)
    except (pint.errors.PintError, ArithmeticError, ValueError, AssertionError, AttributeError, TypeError):
        return None
