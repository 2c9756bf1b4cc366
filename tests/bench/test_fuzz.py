"""A few inputs of each property of ``make fuzz``."""

import fuzz
import pytest

KINDS = [
    pytest.param(kind, marks=pytest.mark.needs("gcc", "cc") if "C and FMU" in kind else ()) for kind in fuzz.PROPERTIES
]


@pytest.mark.parametrize("kind", KINDS)
def test_hostile_input_is_used_or_refused_in_a_sentence_that_names_the_file(kind: str) -> None:
    assert fuzz.run(kind, 40, start=1) > 0
