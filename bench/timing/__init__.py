"""Timing microseconds: the clock, percentiles, and what the machine does meanwhile."""
