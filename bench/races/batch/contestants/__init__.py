"""Contestants with compiled code that is called once per batch, one file each.

A file is named after its contestant and defines one :class:`bench.races.batch.contestant.Contestant`.
"""
