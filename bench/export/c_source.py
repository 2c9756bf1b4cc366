"""Export of a model as C99: the files of the core unchanged, an interface, and rendered files: parameters, example,
makefile.

The core itself reports the size of its states. Interface and templates have the prefix ``piezo``, which another name
may replace.
"""

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from bench.export.settings import (
    BLOCKS,
    EXACT_SOLVER,
    LEARNS,
    SOLVERS,
    ExportError,
    ExportSettings,
    Precision,
    initialiser,
    literal,
)
from bench.rendering import c_templates
from piezo_model import HysteresisCreepModel, ModelStructure, operators, regressors
from piezo_model.core import bindings
from piezo_model.learning.settings import CONTINUOUS, CYCLIC
from piezo_model.prefilter import Prefilter
from piezo_model.units import quantity
from solvers.core import bindings as solvers_bindings
from solvers.core import compile_core

FILES = {
    "piezo_parameters.h": "parameters.h.jinja",
    "main.c": "main.c.jinja",
    "loop.c": "loop.c.jinja",
    "Makefile": "Makefile.jinja",
    "CMakeLists.txt": "CMakeLists.txt.jinja",
    "README.md": "README.md.jinja",
}
"""Rendered files and their templates."""
INTERFACE = Path(__file__).parent / "c"
SHARED = (
    "vec8.h",
    "num.h",
    "arena.h",
    "shape.h",
    "operators.h",
    "prefilter.h",
    "prefilter.c",
    "compensator.h",
    "compensator.c",
)
LEARNER = (
    "mailbox.h",
    "sensor_guard.h",
    "controller.h",
    "controller.c",
    "status.h",
    "product.h",
    "box.h",
    "sweep.h",
    "symmetric.h",
    *(f"box_{name}.c" for name in ("data", "dual", "inverse", "proximal")),
    "descent.h",
    "descent.c",
    "acceleration.c",
    "regressors.h",
    *(f"{name}.c" for name in ("continuous", "cyclic", "learner", "noise", "offer", "optimum")),
    "learner.h",
    "direction.h",
    "rows.h",
)
"""Files of the core: always, and with a learner; preprocessor conditions select the code for the kind of learning."""
FLOAT_BOUND = 1e-5
"""Largest difference between the drives of the float and double versions over a million samples, normalised units."""

environment = c_templates("bench.export")


def render(
    model: HysteresisCreepModel,
    settings: ExportSettings,
    title: str,
    files: Mapping[str, str] = FILES,
    **more: Any,
) -> dict[str, str]:
    """Render files, given by name and template.

    Every file begins with the title, one line; ``more`` are further variables of the templates.
    """
    data = {**variables_of(model, settings, title), **more}
    return {
        _named(name, settings.name): _named(environment.get_template(template).render(data), settings.name)
        for name, template in files.items()
    }


def sources(settings: ExportSettings, *more: str) -> dict[str, str]:
    """Files that are the same for every model: the interface, with ``more`` files of its folder, and the core."""
    learner = ("piezo_learner.h", "piezo_learner.c") if settings.learning else ()
    interface = ("piezo.h", "piezo.c", *learner, *more)
    core = (*SHARED, *(LEARNER if settings.learning else ()))
    folders = compile_core.folders(Path(operators.__file__).parent)
    return {
        **{
            _named(name, settings.name): _named((INTERFACE / name).read_text(encoding="utf-8"), settings.name)
            for name in interface
        },
        **{
            f"core/{name}": next(folder / name for folder in folders if (folder / name).exists()).read_text(
                encoding="utf-8"
            )
            for name in core
        },
    }


def export(
    model: HysteresisCreepModel, settings: ExportSettings | None = None, title: str = "Compensator"
) -> dict[str, str]:
    """Return the text of all files of a folder that builds, by name.

    Examples
    --------
    >>> from piezo_model import ModelStructure
    >>> structure = ModelStructure.equidistant(n=1, m=0, x_range=(-1, 1), y_range=(-1, 1), creep_rates=(),
    ...                                        sample_time=1e-3)
    >>> files = export(HysteresisCreepModel.from_weights(structure, [1.0, 2.0]), ExportSettings(name="axis"))
    >>> sorted(name for name in files if not name.startswith("core"))
    ['CMakeLists.txt', 'Makefile', 'README.md', 'axis.c', 'axis.h', 'axis_parameters.h', 'axis_stage.c', 'axis_stage.h',
     'loop.c', 'main.c']
    >>> "axis_step(axis_axis *axis" in files["axis.h"]
    True
    """
    settings = settings or ExportSettings()
    same = sources(settings, "piezo_stage.h", "piezo_stage.c")
    of_core = "".join(text for name, text in same.items() if name.startswith("core/"))
    if settings.name != "piezo" and (clash := re.search(rf"\b{settings.name}_\w+", of_core, re.IGNORECASE)):
        raise ExportError(
            f"with the name {settings.name!r} a function could be named {clash[0]}, as in core; choose another --name"
        )
    return {**same, **render(model, settings, title)}


def _named(text: str, name: str) -> str:
    """The text with the prefix ``piezo`` replaced, but not in ``piezobench``."""
    if name == "piezo":
        return text
    text = re.sub(r"\bPIEZO(?=_)", name.upper(), text)
    return re.sub(r"\bpiezo(?=_|\b)", name, text).replace("PIEZO_H", f"{name.upper()}_H")


def variables_of(model: HysteresisCreepModel, settings: ExportSettings, title: str) -> dict[str, Any]:
    """Variables of all templates."""
    s, precision = model.structure, settings.precision
    low, high = operators.dead_zone_limits(s.dead_zone_thresholds)
    outer_low, outer_high = regressors.outer_limits(s)
    kind = SOLVERS.index(settings.solver) if settings.cyclic else len(SOLVERS)
    prefilter = Prefilter(model.dynamics, s.sample_time)
    return {
        "title": f"{title}. {model.warning}" if model.warning else title,
        "model": model,
        "s": s,
        "settings": settings.numbers(s),
        "prefilter": prefilter,
        "lag_s": model.lag_s,
        "most_gain": min(model.require_stable(settings.integral_gain), 1.0 / s.sample_time),
        "lag": quantity(model.lag_s, "s", 3),
        "precision": precision,
        "learning": settings.learning,
        "cyclic": settings.cyclic,
        "learning_kind": kind + 1 if settings.learning else 0,
        "what_learns": LEARNS[kind],
        "solver": settings.solver,
        "number": partial(literal, precision=precision),
        "double": literal,
        "list": partial(initialiser, precision=precision),
        "weights": model.all_weights,
        "r_H": s.thresholds,
        "gains": operators.creep_gain(s.creep_rates, s.sample_time),
        "zone_low": low,
        "zone_high": high,
        "outer_low": outer_low,
        "outer_high": outer_high,
        "period": f"{1e6 * s.sample_time:.6g} us" if s.sample_time < 1e-3 else f"{1e3 * s.sample_time:.6g} ms",
        "float_bound": f"{FLOAT_BOUND:g}",
        "memory": memory_figures(s, settings, prefilter),
    }


HEAD = 128
"""HEAD_BYTES in ``arena.h``."""
STACK = 6144
"""Upper bound for all stack frames together, bytes."""


def compensator_bytes(s: ModelStructure, precision: Precision, prefilter: Prefilter) -> int:
    """Size of the compensator's state; in single precision creep states carry their rounding error."""
    size: int = bindings.compensator_bytes(*s.shape, prefilter.modes, prefilter.ring)
    errors = (1 + (prefilter.ring > 0)) * 4 * len(s.creep_rates) * s.lanes
    return size if precision == "double" else HEAD + (size - HEAD) // 2 + errors


def learner_bytes(s: ModelStructure, settings: ExportSettings, prefilter: Prefilter, blocks: int = BLOCKS) -> int:
    """Size of the learner, with the blocks it shares with the step and its exact solver; 0 without learning."""
    if not settings.learning:
        return 0
    numbers, algorithm = settings.numbers(s), CYCLIC if settings.cyclic else CONTINUOUS
    number_bytes, shape = 8 if settings.precision == "double" else 4, (*s.shape, prefilter.modes, prefilter.ring)
    size = int(bindings.exported_learner_bytes(*shape, numbers["block"], blocks, algorithm, number_bytes))
    return size + int(solvers_bindings.box_bytes(s.d)) if settings.cyclic and settings.solver == EXACT_SOLVER else size


def memory_figures(s: ModelStructure, settings: ExportSettings, prefilter: Prefilter) -> dict[str, int]:
    """Bytes of both states, of one block between step and learner, of constants and of the stack."""
    learner = learner_bytes(s, settings, prefilter)
    constants = 8 * (2 * (s.n + 1) + len(s.creep_rates) + s.dead_zones * (7 if learner else 3) + s.creep_weights + 1)
    constants += 8 * prefilter.constants.size
    stack = 8 * (2 * s.d + 2 * s.lanes * (1 + len(s.creep_rates)) + 4 * s.d)
    return {
        "compensator": compensator_bytes(s, settings.precision, prefilter),
        "learner": learner,
        "block": learner - learner_bytes(s, settings, prefilter, BLOCKS - 1),
        "constants": constants,
        "stack": -(-(stack + (STACK if learner else 1024)) // 256) * 256,
    }
