"""One setting for all property tests: no deadline, since the first call of a kernel compiles it and machines differ."""

from hypothesis import settings

settings.register_profile("piezobench", deadline=None)
settings.load_profile("piezobench")
