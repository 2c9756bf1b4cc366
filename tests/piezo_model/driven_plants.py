"""Simulated actuators, and drives for them in volts."""

from functools import partial

import numpy as np
import pytest

from piezo_model import plants
from piezo_model.signals import random_walk

TS = 1e-3
NAMES = plants.names()
every_plant = pytest.mark.parametrize("name", NAMES)


bare = partial(plants.get, sample_time=TS)


def ramp(*turns, per_ramp=200):
    """Drive that visits the turning points, V."""
    return np.interp(np.arange((len(turns) - 1) * per_ramp + 1) / per_ramp, np.arange(len(turns)), turns)


def walk(seconds=2.0, seed=0):
    return random_walk(duration_s=seconds, sample_time=TS, low=0.0, high=150.0, seed=seed, spread_per_root_s=3.0)
