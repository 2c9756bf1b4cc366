"""Compiled solvers of our own: no Python call inside a solve."""
