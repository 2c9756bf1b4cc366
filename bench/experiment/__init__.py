"""The paper's experiment on a simulated stage: its Fig. 4 and what belongs to it, one figure a file.

`bench.stage` is the stage with its reference and what is done on it; `experiment` makes the figures and their report.
Figures 1 to 3, and others, are scripts in ``examples/experiment/`` of the repository.
"""
