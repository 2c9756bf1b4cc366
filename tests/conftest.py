"""One setting for all property tests: no deadline, since machines differ; and one browser for all tests that look at pages."""

import os
import sys
from collections.abc import Iterator

import pytest
from browser import Browser
from hypothesis import settings

# The tests start hundreds of processes, each of which would compile every module of ours again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

settings.register_profile("piezobench", deadline=None)
settings.load_profile("piezobench")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = Browser()
    yield found
    found.close()
