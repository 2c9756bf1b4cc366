"""The races: full solves, accuracy within a time, sample by sample at 8 kHz, and learning in the loop, each in a folder
of its own.

A folder has the settings and the table of the race, how it runs, what its child processes do, its figures, plots and
report. Its ``kind.py`` defines ``KIND``, a :class:`bench.races.kind.Kind`. The files beside the folders are what they
share.
"""
