"""Solvers of the lane codegen, one a file: embedded C, built here by one compiler with one set of flags."""
