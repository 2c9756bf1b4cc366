"""The simulated two-axis stage with its reference and learners, and its runs along a straight line or with
learning."""
