"""Work in separate processes with limits: solvers, certificates, the sentinel, and parts of a race on several
cores.

What other parts import is in ``__init__.pyi``; each name is imported from its file when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
