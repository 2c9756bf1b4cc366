"""Export of the compensator as an FMU for Co-Simulation, FMI 2.0 or 3.0, from the same C source.

A communication step of one sampling period reads the reference at its start and gives the drive at its end. The FMU
contains a binary for the machine it was built on and the source for any other.

Source: Functional Mock-up Interface 2.0.4 and 3.0.1, fmi-standard.org.
"""

import tempfile
import uuid
import zipfile
from pathlib import Path
from platform import machine
from typing import NamedTuple

from markupsafe import Markup

from bench.export import building, c_source
from bench.export.settings import ExportSettings
from bench.rendering import markup_templates
from piezo_model import HysteresisCreepModel
from piezo_model.atomic_file import replacing

VARIABILITY = {"parameter": "fixed", "local": "constant"}
"""By causality; inputs and outputs are discrete."""
NAMESPACE = uuid.UUID("6f0d5a1e-57a4-5a0b-9d0e-0f6a4b8f7c11")
METRE = 'm="1"'
BASE_UNITS = {
    "s": 's="1"',
    "1/s": 's="-1"',
    "V": 'kg="1" m="2" s="-3" A="-1"',
    "V/s": 'kg="1" m="2" s="-4" A="-1"',
    "mV": 'kg="1" m="2" s="-3" A="-1" factor="1e-3"',
    "kV": 'kg="1" m="2" s="-3" A="-1" factor="1e3"',
    "m": METRE,
    "mm": f'{METRE} factor="1e-3"',
    "um": f'{METRE} factor="1e-6"',
    "µm": f'{METRE} factor="1e-6"',
    "nm": f'{METRE} factor="1e-9"',
    "rad": 'rad="1"',
    "mrad": 'rad="1" factor="1e-3"',
    "urad": 'rad="1" factor="1e-6"',
    "A": 'A="1"',
    "N": 'kg="1" m="1" s="-2"',
}
"""Units of recordings in the standard's base units; any other unit is named without a definition."""


class Variable(NamedTuple):
    """A variable of the FMU; its value reference is its place in the list of all, counted from 1."""

    name: str
    causality: str
    start: float
    unit: str
    description: str


def variables(model: HysteresisCreepModel, settings: ExportSettings) -> list[Variable]:
    """Inputs, output, parameters and the lag with units and start values."""
    s = model.structure
    numbers = settings.numbers(s)
    x, y, rate = s.input_unit, s.output_unit, settings.rate_limit or 0.0
    return [
        Variable("reference", "input", s.y_centre, y, "Wanted output of the actuator"),
        Variable("drive", "output", numbers["x_start"], x, "Drive of the actuator"),
        Variable("lowest_drive", "parameter", numbers["low"], x, "Lower limit of the drive"),
        Variable("highest_drive", "parameter", numbers["high"], x, "Upper limit of the drive"),
        Variable(
            "rate_limit", "parameter", rate, f"{x}/s" if x else "", "Largest change of the drive per second, 0 for none"
        ),
        Variable("measured", "input", s.y_centre, y, "Output that the last drive produced, for the integral action"),
        Variable("integral_gain", "parameter", settings.integral_gain, "1/s", "Of the integral action, 0 for none"),
        Variable("lag", "local", model.lag_s, "s", "Time by which the output lags a slow reference"),
    ]


def write_fmu(model: HysteresisCreepModel, settings: ExportSettings, out: Path, fmi: int = 3) -> None:
    """Write the FMU of the compensator, in double precision, whole or not at all; ExportError without a C compiler."""
    title = f"Compensator of hysteresis and creep, d = {model.structure.d}"
    code = {
        **c_source.sources(settings, f"fmi{fmi}.c", "fmu.h"),
        **c_source.render(model, settings, title, {"piezo_parameters.h": "parameters.h.jinja"}),
    }
    declared = variables(model, settings)
    units = dict.fromkeys(["s", *(v.unit for v in declared if v.unit)])
    about = {
        "name": settings.name,
        "token": f"{{{uuid.uuid5(NAMESPACE, ''.join(code.values()))}}}",
        "fmi": fmi,
        "variables": declared,
        "variability": VARIABILITY,
        "units": {unit: Markup(BASE_UNITS.get(unit, "")) for unit in units},
        "rate_limit": settings.rate_limit or 0.0,
        "integral_gain": settings.integral_gain,
    }
    code |= c_source.render(model, settings, title, {"piezo_fmu.h": "fmu.h.jinja"}, **about)
    described, templates = {**c_source.variables_of(model, settings, title), **about}, markup_templates("bench.export")
    contents: dict[str, str | bytes] = {f"sources/{key}": text for key, text in code.items()}
    contents["modelDescription.xml"] = templates.get_template(f"modelDescription{fmi}.xml.jinja").render(described)
    if fmi == 3:
        description = templates.get_template("buildDescription.xml.jinja").render(described)
        contents["sources/buildDescription.xml"] = description
    platform = "linux64" if fmi == 2 and machine() == "x86_64" else f"{machine()}-linux"
    contents[f"binaries/{platform}/{settings.name}.so"] = _library(code, settings.name, fmi)
    with replacing(out) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in contents.items():
            archive.writestr(path, content)


def _library(code: dict[str, str], name: str, fmi: int) -> bytes:
    flags = (*building.WARNINGS, "-Wno-unused-parameter", *building.EXACT, "-O2", "-fPIC", "-shared")
    with tempfile.TemporaryDirectory(prefix="piezobench-fmu-") as folder:
        building.write_files(Path(folder), code)
        building.compile_c(Path(folder), [*flags, f"{name}.c", f"fmi{fmi}.c", "-o", "library.so", "-lm"], "the FMU")
        return (Path(folder) / "library.so").read_bytes()
