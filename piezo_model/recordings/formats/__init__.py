"""Formats of recordings, one file each; adding a format means adding a file, and nothing else changes.

A format's module has ``NAME`` ("an HDF5 file"), ``recognises(path, head)``, which decides by the first bytes and
accepts no file of another format (plain text has none: it is the fallback), and ``open_table(path, options)``, which
returns a :class:`piezo_model.recordings.tables.Table`; :func:`piezo_model.recordings.tables.in_memory` makes one of
arrays. Optional packages are imported inside ``open_table``; if one is missing, the error says what to install. A
format that a C library parses has ``SUBPROCESS = True``: it is read in a child process
(:mod:`piezo_model.recordings.subprocess_reader`), and its table is a
:class:`piezo_model.recordings.tables.ArrayTable`. ``READS`` names the supported options among ``header_row``,
``decimal`` and ``sheet``; the others are refused.
"""
