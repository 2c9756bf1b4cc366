"""The simulated two-axis stage with its reference and its learners, and what it does along a line or while it
learns."""
