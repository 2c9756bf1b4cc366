"""Solver libraries driven through their own persistent object."""
