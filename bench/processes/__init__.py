"""Solvers in processes of their own, with limits, and the engine that spreads work over cores."""
