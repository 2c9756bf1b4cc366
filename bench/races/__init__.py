"""The kinds of race, each in its own folder, and the modules that they share.

A folder holds the settings, the table, the tasks, the requests to child processes, the figures and the report of a
race. Its ``report.py`` defines ``KIND``, a :class:`bench.races.kind.Kind`.

What other parts import is in ``__init__.pyi``; each name is imported from its file when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
