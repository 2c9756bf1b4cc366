"""Messages between the parts of a race: a task goes down to a solver as a request, an outcome comes back, and a row is
saved.

What other parts import is in ``__init__.pyi``; each name is imported from its file when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
