"""One setting for all property tests: no deadline, since machines differ; and one browser for all tests that look at pages."""

from collections.abc import Iterator

import pytest
from browser import Browser
from hypothesis import settings

settings.register_profile("piezobench", deadline=None)
settings.load_profile("piezobench")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = Browser()
    yield found
    found.close()
