"""The stream race as the rest sees it."""

from bench.races.kind import Kind
from bench.races.stream import race, report
from bench.races.stream.race import STREAM, StreamSettings

KIND = Kind("stream", "Stream race", "sample by sample at 8 kHz", STREAM, StreamSettings, race.race, report.report,
            entries=race.check)
