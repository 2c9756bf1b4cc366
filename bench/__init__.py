"""Races, judges, stores and reports: the benchmark and its command line."""
