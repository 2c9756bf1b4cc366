"""Runs side by side: matched rows, paired ratios, what differs."""
