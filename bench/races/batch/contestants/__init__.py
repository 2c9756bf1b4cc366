"""Who takes part in a batch race: a file a contestant, in the folder of its lane.

In the lane kernel a batch is one call of compiled code; in the lane direct it is a loop in Python over the library's own call for one
program. A file is named like its contestant and defines one :class:`bench.races.batch.contestant.Contestant`.
"""
