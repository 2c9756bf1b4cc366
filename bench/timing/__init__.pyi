from .clock import LEAST_SHARE, LONG_NS, Effort, answers_us
from .percentiles import percentile
from .schedule import PERIOD_US

__all__ = [
    "LEAST_SHARE",
    "LONG_NS",
    "PERIOD_US",
    "Effort",
    "answers_us",
    "percentile",
]
