from .chosen_settings import EACH, Choices, choices, definition, table_of, tier_label
from .driver import Part, Race, TaskRace, Tell
from .kind import Kind
from .run_problems import problems_of, save_certificates
from .settings import Positive, RaceSettings, TierSettings, fixed, option

__all__ = [
    "EACH",
    "Choices",
    "Kind",
    "Part",
    "Positive",
    "Race",
    "RaceSettings",
    "TaskRace",
    "Tell",
    "TierSettings",
    "choices",
    "definition",
    "fixed",
    "option",
    "problems_of",
    "save_certificates",
    "table_of",
    "tier_label",
]
