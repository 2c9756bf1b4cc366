"""Simulated actuators that are not in the model class; the folder is the registry.

A file of this folder that defines one :class:`~piezo_model.plants.actuator.Actuator` adds the plant of the file's name.
"""

import dataclasses
import importlib
import pkgutil
from typing import Any

from piezo_model.plants.actuator import Actuator
from piezo_model.plants.flexure import Flexure
from piezo_model.plants.protocol import Plant
from piezo_model.plants.sensor import Sensor

__all__ = ["STAGES", "Actuator", "Flexure", "Plant", "Sensor", "get", "names", "stage"]


def _classes() -> dict[str, type[Actuator]]:
    modules = [f"{__name__}.{file.name}" for file in pkgutil.iter_modules(__path__)]
    for module in modules:
        importlib.import_module(module)
    return {cls.__module__.rpartition(".")[2]: cls for cls in Actuator.__subclasses__() if cls.__module__ in modules}


STAGES = {"flexure": Flexure.scanner}
"""Actuators in a stage, by name."""


def names() -> list[str]:
    """Names of the simulated actuators."""
    return sorted(_classes())


def stage(name: str, sample_time: float) -> Plant:
    """Make one of :data:`STAGES` or a simulated actuator by name; KeyError if there is neither.

    Examples
    --------
    >>> stage("flexure", 1e-4).sample_time
    0.0001
    """
    return STAGES[name](sample_time) if name in STAGES else get(name, sample_time=sample_time)


def get(name: str, **options: Any) -> Actuator:
    """Make a simulated actuator by name.

    Parameters
    ----------
    name : str
        One of :func:`names`.
    **options
        Fields of its class.

    Raises
    ------
    KeyError
        If there is no such plant.
    ValueError
        If the plant has no such option, or its value is invalid.

    Examples
    --------
    >>> from piezo_model import plants
    >>> plant = plants.get("bouc_wen", x_range=(0.0, 120.0))
    >>> y = plant.run([0.0, 60.0, 120.0])
    >>> bool((y[1:] > y[:-1]).all())
    True
    """
    classes = _classes()
    if name not in classes:
        raise KeyError(f"there is no plant {name!r}; known are {', '.join(sorted(classes))}")
    known = [f.name for f in dataclasses.fields(classes[name]) if f.init]
    for option in options:
        if option not in known:
            raise ValueError(f"the plant {name!r} has no option {option!r}; it has {', '.join(known)}")
    return classes[name](**options)
