"""The one-shot race as the rest sees it, and the anytime race, which is one with limits of iterations whose report
begins with another picture."""

from bench.races.kind import Kind
from bench.races.oneshot import report
from bench.races.oneshot.race import OneshotRace
from bench.races.oneshot.settings import AnytimeSettings, OneshotSettings

KIND = Kind("oneshot", "One-shot race", "full solves", OneshotSettings, OneshotRace, report.report)
ANYTIME = Kind("anytime", "Anytime race", "accuracy within a time", AnytimeSettings, OneshotRace, report.anytime_report)
