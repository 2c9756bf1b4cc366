"""Timing of microseconds: the clock, percentiles, and disturbances by the machine."""
