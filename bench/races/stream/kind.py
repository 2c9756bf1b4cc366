"""The stream race as the rest sees it."""

from bench.races.kind import Kind
from bench.races.stream import report
from bench.races.stream.race import StreamRace, StreamSettings

KIND = Kind("stream", "Stream race", "sample by sample at 8 kHz", StreamSettings, StreamRace, report.report)
