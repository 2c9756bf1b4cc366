"""Fixtures of the tests in this folder: small races that they share, and a scheduler of Dask."""

from small_races import clean_race, faulty_race, scheduler, wide_race

__all__ = ["clean_race", "faulty_race", "scheduler", "wide_race"]
