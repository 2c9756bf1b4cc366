"""Compiled arithmetic that our own solvers share: plain functions over arrays, no solver class among them."""
