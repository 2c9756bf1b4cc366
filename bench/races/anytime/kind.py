"""The anytime race as the rest sees it."""

from bench.races.anytime import race, report
from bench.races.anytime.race import ANYTIME, AnytimeSettings
from bench.races.kind import Kind

KIND = Kind("anytime", "Anytime race", "accuracy within a time", ANYTIME, AnytimeSettings, race.race, report.report)
