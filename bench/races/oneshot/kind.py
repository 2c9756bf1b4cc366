"""The one-shot race, and the anytime race: a one-shot race with iteration limits whose report begins with the accuracy
within a time."""

from bench.races.kind import Kind
from bench.races.oneshot import report
from bench.races.oneshot.race import OneshotRace
from bench.races.oneshot.sessions import anchors
from bench.races.oneshot.settings import AnytimeSettings, OneshotSettings

KIND = Kind("oneshot", "One-shot race", "full solves", OneshotSettings, OneshotRace, report.report, anchors)
ANYTIME = Kind("anytime", "Anytime race", "accuracy within a time", AnytimeSettings, OneshotRace, report.anytime_report)
