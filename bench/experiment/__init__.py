"""The paper's experiment on a simulated stage: its Fig. 4 and what belongs to it, one figure a file.

`rig` is the stage with its reference, `trial` what is done on it, each figure an ``Exhibit`` (`style`), and `experiment` makes
them all and their page.
"""
