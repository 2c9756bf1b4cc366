"""The closed-loop race as the rest sees it."""

from bench.races.kind import Kind
from bench.races.loop import report
from bench.races.loop.race import LoopRace, LoopSettings

KIND = Kind("loop", "Closed-loop race", "learning in the loop with a stage", LoopSettings, LoopRace, report.report)
