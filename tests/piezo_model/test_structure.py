import json
import math
from typing import Any

import numpy as np
import pytest

from piezo_model.json_file import decoded
from piezo_model.structure import ModelStructure, StructureError


def equidistant(**changes: Any) -> ModelStructure:
    return ModelStructure.equidistant(
        **{
            "n": 5,
            "m": 3,
            "x_range": (0.0, 150.0),
            "y_range": (-20.0, 20.0),
            "creep_rates": (10.0, 1.0),
            "sample_time": 125e-6,
            **changes,
        }
    )


def test_creep_weights_do_not_grow_with_the_rates_and_go_without_them() -> None:
    assert [equidistant(creep_rates=rates).d for rates in ((), (1.0,), (100.0, 10.0, 1.0, 0.1))] == [12, 18, 18]
    assert equidistant(offset=True).weight_names[-1] == "offset"


def test_a_descending_output_range_gives_the_structure_of_the_reversed_output() -> None:
    for low, high in ((-20.0, 20.0), (3.0, 7.0)):
        descending, ascending = equidistant(y_range=(high, low)), equidistant(y_range=(low, high))
        assert descending == ascending.reversed_output()
        assert descending.negative_gain
        assert not ascending.negative_gain
        np.testing.assert_allclose(descending.unit_output(np.array([high, low])), [-1.0, 1.0])


def test_ranges_become_the_unit_interval() -> None:
    s = equidistant()
    assert s.unit_input(np.array([0.0, 75.0, 150.0])).tolist() == [-1.0, 0.0, 1.0]
    assert s.unit_output(np.array([-20.0, 0.0, 20.0])).tolist() == [-1.0, 0.0, 1.0]


def test_bounds_are_zero_for_weights_the_least_slope_for_slopes_and_none_for_the_offset() -> None:
    lb = equidistant(n=1, m=1, offset=True).lower_bounds(0.01)
    assert lb.tolist() == [0.0, 0.01, 0.01, 0.01, 0.0, 0.0, -math.inf]


def test_numbers_of_numpy_are_taken_and_survive_json_too() -> None:
    s = equidistant(sample_time=np.float32(0.5), creep_rates=np.array([2, 1]), offset=np.True_)
    assert decoded(json.dumps(s.to_dict()), ModelStructure) == s


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"n": -1}, "n must be a whole number of at least 0, not -1"),
        ({"x_range": (1.0, 1.0)}, r"x_range must be two finite numbers in ascending order, not \(1.0, 1.0\)"),
        ({"y_range": (0.0, math.nan)}, "y_range must be two finite numbers"),
        ({"y_range": (2.0, 2.0)}, r"y_range must be two finite numbers that differ, not \(2.0, 2.0\)"),
        ({"x_range": (1.0, -1.0)}, r"x_range must be two finite numbers in ascending order, not \(1.0, -1.0\)"),
        ({"creep_rates": (1.0, -1.0)}, r"creep_rates must be from 1e-100 to 1e\+100, not \(1.0, -1.0\)"),
        ({"creep_rates": (1.0, 1.0)}, "creep_rates must differ from each other"),
        ({"creep_rates": (math.inf,)}, "creep_rates must be from"),
        ({"sample_time": 0.0}, "sample_time must be from 1e-09 to 1e.09, not 0.0"),
        ({"sample_time": math.nan}, "sample_time must be from 1e-09 to 1e.09, not nan"),
    ],
)
def test_an_invalid_structure_is_refused_by_the_name_of_its_field(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(StructureError, match=sentence):
        equidistant(**changes)


@pytest.mark.parametrize(
    ("play", "dead_zone", "sentence"),
    [
        ([0.5, 0.5], [0.0], "play_thresholds must be positive and ascending"),
        ([0.0], [0.0], "play_thresholds must be positive and ascending"),
        ([], [0.1, 0.2], "dead_zone_thresholds must be ascending with 0 among them"),
        ([], [], "dead_zone_thresholds must be ascending with 0 among them"),
        ([], [0.0, 0.5, 0.2], "dead_zone_thresholds must be ascending with 0 among them"),
    ],
)
def test_thresholds_out_of_order_are_refused(play: list[float], dead_zone: list[float], sentence: str) -> None:
    with pytest.raises(StructureError, match=sentence):
        ModelStructure(tuple(play), tuple(dead_zone), (), 1e-3, 0.0, 1.0, 0.0, 1.0)
