"""The races: full solves, accuracy within a time, sample by sample at 8 kHz, and learning in the loop."""
