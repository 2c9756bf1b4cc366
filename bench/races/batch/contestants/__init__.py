"""Who takes part in a batch race with compiled code that is called once for a batch: a file a contestant.

A file is named like its contestant and defines one :class:`bench.races.batch.contestant.Contestant`.
"""
