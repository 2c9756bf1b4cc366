"""The table of a one-shot race, of which everything else is a function."""

from bench.store import Schema

ONESHOT = Schema("rows.parquet", (
    "problem_set", "problem", "d", "solver", "lane", "setting", "rung", "is_default", "scaling", "start", "repeat", "host", "settings",
    "status", "message", "cost_gap", "violation", "timed_gap", "primal_residual", "dual_residual", "duality_gap", "weight_error",
    "model_error_percent", "stage_excess", "model_error_um", "optimum_error_um", "noise_um",
    "setup_us", "update_us", "solve_us_p50", "solve_us_p50_low",
    "solve_us_p50_high", "solve_us_p99", "solve_us_p99_low", "solve_us_p99_high", "solve_us_max", "samples",
    "interleaved_us_p50", "interleaved_us_p99", "periods", "reported_us",
    "iterations", "mutates_input", "repeatable", "preemptions"),
    ("problem_set", "problem", "scaling", "solver", "lane", "rung", "start", "repeat"))
"""One row a measurement."""
