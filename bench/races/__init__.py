"""The races: full solves, accuracy within a time, sample by sample at 8 kHz, and learning in the loop, each in a room of its own.

In a room are the settings and the table of the race, how it runs, what its children do, its figures, plots and report; ``kind.py``
is what the rest sees. The files beside the rooms are what they share.
"""
