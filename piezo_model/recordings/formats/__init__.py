"""Formats of recordings, one file each; adding a format means adding a file, and nothing else changes.

A format's module has ``NAME`` ("an HDF5 file"), ``recognises(path, head)``, which decides by the first bytes and takes
no file of another format (plain text has none: it is what remains), and ``open_table(path, reading)``, which returns a
:class:`piezo_model.recordings.tables.Table`; :func:`piezo_model.recordings.tables.in_memory` makes one of arrays.
Optional packages are imported inside ``open_table``: where one is missing, the user is told what to install. With
``APART = True`` a format, which a library in C parses, is read in a child process
(:mod:`piezo_model.recordings.subprocess_reader`), and its table is a
:class:`piezo_model.recordings.tables.ArrayTable`. ``READS`` names what it goes by of that which a user may say of a
file (``header_row``, ``decimal``, ``sheet``); what it does not name is refused.
"""
