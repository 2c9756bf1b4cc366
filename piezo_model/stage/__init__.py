"""The two-axis stage: its axes, their decoupling, and learning on both."""
