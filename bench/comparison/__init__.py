"""Comparison of runs: matched rows, paired ratios, differences."""
