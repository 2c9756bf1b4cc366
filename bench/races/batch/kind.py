"""The batch race as the rest sees it."""

from bench.races.batch import race, report
from bench.races.batch.race import BATCH, BatchSettings
from bench.races.kind import Kind

KIND = Kind("batch", "Batch race", "many programs at once", BATCH, BatchSettings,
            race.race, report.report, entries=race.asked_for)
