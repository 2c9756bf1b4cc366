from .fresh import FreshData, mixture
from .protocol import CertifiedForm, ProblemSet, ProblemSetError, RaceProblem
from .registry import all_sets, check_options, find, make, sets

__all__ = [
    "CertifiedForm",
    "FreshData",
    "ProblemSet",
    "ProblemSetError",
    "RaceProblem",
    "all_sets",
    "check_options",
    "find",
    "make",
    "mixture",
    "sets",
]
