"""Formats of recordings, one a file; to add a format is to add a file, and nothing else is touched.

A format's module has ``NAME`` ("an HDF5 file"), ``ORDER`` (small ones are asked first), ``recognises(path, head)``, which tells
by the first bytes, and ``open_table(path, reading)``, which gives a :class:`piezo_model.recordings.tables.Table`. What a format
needs beyond the base is imported inside ``open_table``: where it is missing, the user is told what to install. With
``APART = True`` a format, which a library in C parses, is read in a child process (:mod:`piezo_model.recordings.apart`), and its
table is a :class:`piezo_model.recordings.tables.ChannelTable`.
"""
