"""Settings of a self-learning compensator."""

from dataclasses import asdict

import pytest

from piezo_model.json_file import convert
from piezo_model.learning.settings import LearningSettings


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"mode": "sideways"}, "mode must be one of cyclic, continuous, not 'sideways'"),
        ({"build_s": 0.0}, "build_s must be a positive number of seconds up to 1e.09, not 0.0"),
        ({"learn_s": float("nan")}, "learn_s must be a positive number of seconds up to 1e.09, not nan"),
        ({"proximal": -1.0}, "proximal must be at least 0 and below 1, not -1.0"),
        ({"samples_to_solve": 0}, "samples_to_solve must be a whole number from 1 to \\d+, not 0"),
        ({"samples_to_solve": 2**70}, "samples_to_solve must be a whole number from 1 to \\d+, not"),
        ({"solver": "nobody"}, "there is no solver 'nobody'"),
    ],
)
def test_settings_that_cannot_be_are_refused_in_one_sentence(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence.replace("(", r"\(")):
        LearningSettings(**options)  # type: ignore[arg-type]


def test_settings_survive_their_dictionary_and_unknown_ones_are_named() -> None:
    settings_ = LearningSettings(x_limits=(0.0, 1.0), solver_options={"lane": "kernel"})
    assert convert(asdict(settings_), LearningSettings) == settings_
    with pytest.raises(ValueError, match="there is no field 'speed'"):
        convert({"speed": 1}, LearningSettings)
