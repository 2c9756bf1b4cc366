"""The one-shot race as the rest sees it."""

from bench.derived.table import ONESHOT
from bench.races.kind import Kind
from bench.races.oneshot import race, report
from bench.races.oneshot.settings import OneshotSettings

KIND = Kind("oneshot", "One-shot race", "full solves", ONESHOT, OneshotSettings, race.race, report.report, spreads=True)
