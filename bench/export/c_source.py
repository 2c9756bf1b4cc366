"""A model as C99 source: one header, one source, one parameter file, and what it takes to build and understand them.

The templates are C with the prefix ``piezo``; another name is put in its place after rendering.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from bench.export import memory, numbers
from bench.export.settings import ExportSettings
from bench.rendering import c_templates
from piezo_model import HysteresisCreepModel
from piezo_model.learning import sensor_guard
from piezo_model.operators import creep_gain, dead_zone_limits
from piezo_model.regressors import RegressorArrays

FILES = {"piezo_parameters.h": "parameters.h.jinja", "piezo.h": "header.h.jinja", "piezo.c": "source.c.jinja",
         "main.c": "main.c.jinja", "Makefile": "Makefile.jinja", "CMakeLists.txt": "CMakeLists.txt.jinja",
         "README.md": "README.md.jinja"}
FLOAT_BOUND = 1e-5
"""Largest difference of the float from the double version in unit amplitudes of the drive, over a million samples."""

environment = c_templates("bench.export")


def render(model: HysteresisCreepModel, settings: ExportSettings | None = None, title: str = "Compensator",
           files: Mapping[str, str] = FILES, more: Mapping[str, Any] | None = None) -> dict[str, str]:
    """Return the text of each file.

    Parameters
    ----------
    model : HysteresisCreepModel
    settings : ExportSettings, optional
    title : str
        First words of every file; one line.
    files : mapping
        Name of each file and its template.
    more : mapping, optional
        What else the templates need.

    Examples
    --------
    >>> from piezo_model import ModelStructure
    >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
    ...                                        sample_time=1e-3)
    >>> files = render(HysteresisCreepModel.from_weights(structure, [1.0, 2.0]), ExportSettings(name="axis"))
    >>> sorted(files)
    ['CMakeLists.txt', 'Makefile', 'README.md', 'axis.c', 'axis.h', 'axis_parameters.h', 'main.c']
    >>> "axis_step(axis_axis *axis" in files["axis.h"]
    True
    """
    settings = settings or ExportSettings()
    data = {**known(model, settings, title), **(more or {})}
    return {_named(name, settings.name): _named(environment.get_template(template).render(data), settings.name)
            for name, template in files.items()}


def _named(text: str, name: str) -> str:
    """The text with the prefix in place of ``piezo``; ``piezobench`` stays."""
    if name == "piezo":
        return text
    text = re.sub(r"\bPIEZO(?=_)", name.upper(), text)
    return re.sub(r"\bpiezo(?=_|\b)", name, text).replace("PIEZO_H", f"{name.upper()}_H")


def known(model: HysteresisCreepModel, settings: ExportSettings, title: str) -> dict[str, Any]:
    """What every template may refer to."""
    s, precision = model.structure, settings.precision
    low, high = dead_zone_limits(s.dead_zone_thresholds)
    outer = RegressorArrays.of(s, "slope").outer
    number = partial(numbers.literal, precision=precision)
    return {
        "title": title, "model": model, "s": s, "settings": settings.numbers(s), "precision": precision,
        "learning": settings.learning, "cyclic": settings.cyclic,
        "number": number, "wide": _constant, "double": numbers.literal,
        "list": partial(numbers.initialiser, precision=precision),
        "r_H": np.array((0.0, *s.play_thresholds)), "gains": creep_gain(s.creep_rates, s.sample_time),
        "zone_low": low, "zone_high": high, "outer_low": outer.low[:s.dead_zones], "outer_high": outer.high[:s.dead_zones],
        "guard": {"plausible": sensor_guard.PLAUSIBLE, "frozen_drive": sensor_guard.FROZEN_DRIVE,
                  "jump": sensor_guard.JUMP, "following": sensor_guard.FOLLOWING},
        "period": _period(s.sample_time), "float_bound": f"{FLOAT_BOUND:g}",
        "memory": memory.figures(s, settings), "operations": numbers.operations(s, settings.learning, settings.cyclic),
        "special": 4 * s.d**2 + 11 * s.d if settings.cyclic else s.d * (s.d + 1)**2 + 12 * s.d * (s.d + 1),
    }


def _constant(value: float) -> str:
    return numbers.literal(value)


def _period(seconds: float) -> str:
    return f"{1e6 * seconds:.6g} us" if seconds < 1e-3 else f"{1e3 * seconds:.6g} ms"
