"""The closed-loop race as the rest sees it."""

from bench.races.kind import Kind
from bench.races.loop import race, report
from bench.races.loop.race import LOOP, LoopSettings

KIND = Kind("loop", "Closed-loop race", "learning in the loop with a stage", LOOP, LoopSettings, race.race, report.report,
            entries=race.check)
