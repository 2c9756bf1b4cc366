"""The properties of ``make fuzz``, a few inputs of each."""

import fuzz
import pytest

KINDS = [
    pytest.param(kind, marks=pytest.mark.needs("gcc", "cc") if "C and FMU" in kind else ()) for kind in fuzz.PROPERTIES
]


@pytest.mark.parametrize("kind", KINDS)
def test_hostile_input_is_used_or_refused_and_what_we_write_comes_back(kind: str) -> None:
    assert fuzz.run(kind, 40, start=1) > 0
