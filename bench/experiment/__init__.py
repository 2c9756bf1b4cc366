"""The paper's experiment on a simulated stage: its Fig. 4, hysteresis loops and the error of each cycle.

`bench.stage` simulates the stage and its runs; `experiment` makes the figures and the report. Figures 1 to 3, and
others, are scripts in ``examples/experiment/`` of the repository.
"""
