"""One setting for all property tests: no deadline, since machines differ."""

from hypothesis import settings

settings.register_profile("piezobench", deadline=None)
settings.load_profile("piezobench")
