"""The statistics of all races: each has one definition, which tables, sentences and plots share.

The time of an answer is that of update and solve of the same call (`bench.timing.clock.answers_us`), so what is shown
is a median of sums and never a sum of medians. It is the median of the calls of a task, then of its repeats, and then
of the problems. A percentile is that of all calls of all tasks in question together (`bench.timing.percentiles`), and
never a mean of percentiles. Of accuracies, the worst counts.
"""

import numpy as np
import pandas as pd

from bench.messages.task import Status

TYPICAL = "median"
"""Of times, those that are known."""


def typical_of_all(values: pd.Series) -> float:
    """The median; NaN if any value is missing, so that the fast problems do not stand for all."""
    return float(values.median(skipna=False))


def worst(values: pd.Series) -> float:
    """The largest value, or NaN if any is NaN: a failed problem must not look like an accurate one."""
    return float(values.max(skipna=False))


def root_mean_square(values: pd.Series) -> float:
    """The RMS value."""
    return float(np.sqrt(np.mean(values**2)))


def least_good(statuses: pd.Series) -> str:
    """The first failure, else missed if any answer missed, else ok."""
    return str(max(statuses, key=lambda status: (status != Status.OK) + (status not in (Status.OK, Status.MISSED))))


def first_text(texts: pd.Series) -> str:
    """The first text that is not empty; "" if there is none."""
    return next((str(text) for text in texts if text), "")
