"""Quadratic programs and everything that solves them; knows nothing of piezo actuators.

The public names are in ``__init__.pyi``; each is imported from its file when it is first used.
"""

import warnings

import lazy_loader

# qpsolvers warns at import if it finds none of its solvers; those here do not need them.
warnings.filterwarnings("ignore", message="no QP solver found", category=UserWarning, module="qpsolvers")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
