"""The batch race as the rest sees it."""

from bench.races.batch import report
from bench.races.batch.race import BatchRace, BatchSettings
from bench.races.kind import Kind

KIND = Kind("batch", "Batch race", "many programs at once", BatchSettings, BatchRace, report.report)
