"""Compiled solvers, ours and by the C functions of libraries: no Python call inside a solve."""
