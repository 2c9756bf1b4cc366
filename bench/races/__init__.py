"""The kinds of race, each in its own folder, and the modules that they share.

A folder holds the settings, the table, the tasks, the requests to child processes, the figures and the report of a
race. Its ``report.py`` defines ``KIND``, a :class:`bench.races.kind.Kind`.
"""
