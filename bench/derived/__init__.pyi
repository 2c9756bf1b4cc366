from .measurements import FLOOR, HOT, INTERLEAVED, ONESHOT, Measurements, at_tiers, newest, rows_of
from .tiers import LANE, MEASURED, right, supported, tier_settings

__all__ = [
    "FLOOR",
    "HOT",
    "INTERLEAVED",
    "LANE",
    "MEASURED",
    "ONESHOT",
    "Measurements",
    "at_tiers",
    "newest",
    "right",
    "rows_of",
    "supported",
    "tier_settings",
]
