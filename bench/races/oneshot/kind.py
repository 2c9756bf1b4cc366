"""The one-shot race as the rest sees it, and the anytime race, which is one with limits of iterations whose report begins with another picture."""

from bench.derived.table import ONESHOT
from bench.races.kind import Kind
from bench.races.oneshot import race, report
from bench.races.oneshot.settings import AnytimeSettings, OneshotSettings

KIND = Kind("oneshot", "One-shot race", "full solves", ONESHOT, OneshotSettings, race.race, report.report, spreads=True)
ANYTIME = Kind("anytime", "Anytime race", "accuracy within a time", ONESHOT, AnytimeSettings, race.race, report.anytime_report, spreads=True)
