"""Percentiles, refused if the sample is too small, and bounds of the rates of events.

Of N samples in order, X₁ ≤ … ≤ X_N, the q-quantile ξ is the observed X_⌈qN⌉. How many samples lie below ξ is binomial,
so that for any continuous distribution the whole sample holds it with the probability

    P(X₁ ≤ ξ ≤ X_N) = 1 − qᴺ − (1 − q)ᴺ

If that is less than 95 %, there is no percentile: p99.9 needs 2 995 samples and p99.99 needs 29 956.

The samples are taken as independent. Delays come in bursts, so that the true intervals of tails are wider; several
processes and the floor of the machine beside them are the remedy.

Sources: H. A. David and H. N. Nagaraja, Order Statistics, 3rd edition 2003, section 7.1; C. J. Clopper and E. S.
Pearson, Biometrika 26 (1934) 404 to 413.
"""

import itertools
import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv

from piezo_model.checks import check

CONFIDENCE = 0.95
QUANTILES = (0.5, 0.99, 0.999, 0.9999)


def name(q: float) -> str:
    """The usual name of a percentile, such as p99.9."""
    return f"p{100.0 * q:.10g}"


@cache
def needed(q: float) -> int:
    """Fewest samples whose range covers the q-quantile.

    Examples
    --------
    >>> [needed(q) for q in QUANTILES]
    [6, 299, 2995, 29956]
    """
    check(0.0 < q < 1.0, f"a percentile must be between 0 and 1, not {q}")
    return next(count for count in itertools.count(1) if q**count + (1.0 - q) ** count <= 1.0 - CONFIDENCE)


def percentile(sample: ArrayLike, q: float) -> float:
    """The q-quantile of a sample; NaN if it is smaller than :func:`needed` says.

    Examples
    --------
    >>> percentile(np.arange(1, 1001), 0.99), percentile(np.arange(1000), 0.999)
    (990.0, nan)
    """
    values = np.asarray(sample, dtype=np.float64)
    return float(np.quantile(values, q, method="inverted_cdf")) if values.size >= needed(q) else math.nan


def tail_cells(sample: ArrayLike, quantiles: Sequence[float] = QUANTILES, digits: int = 0) -> list[str]:
    """Percentiles and the maximum of a sample as cells of a table, – for a refused percentile.

    Examples
    --------
    >>> tail_cells(np.arange(1000), (0.5, 0.999))
    ['499', '–', '999']
    """
    values = [*(percentile(sample, q) for q in quantiles), float(np.max(sample))]
    return ["–" if math.isnan(value) else f"{value:.{digits}f}" for value in values]


def rate_bound(events: ArrayLike, samples: ArrayLike) -> Any:
    """Clopper and Pearson's upper bound of the rate of events, after ``events`` in ``samples``; 1 without samples.

    Examples
    --------
    >>> round(float(rate_bound(0, 2995)), 6)
    0.001
    >>> rate_bound([0, 1], [100, 100]).round(4)
    array([0.0295, 0.0466])
    """
    events, samples = np.asarray(events), np.asarray(samples)
    bound = betaincinv(events + 1.0, np.maximum(samples - events, 1.0), CONFIDENCE)
    return np.where(events < samples, bound, 1.0)[()]


def rate_ratio(events: int, samples: int, others: int, other_samples: int) -> tuple[float, float]:
    """95 % interval of the rate of ``events`` over that of ``others``, from the binomial distribution of one count
    given the sum of both (Przyborowski and Wilenski, Biometrika 31 (1940) 313); (0, ∞) without any event.

    Examples
    --------
    >>> [round(end, 2) for end in rate_ratio(60, 30_000, 30, 30_000)]
    [1.27, 3.21]
    >>> rate_ratio(0, 3_000, 0, 3_000)
    (0.0, inf)
    """
    if not events + others:
        return 0.0, math.inf
    tail = (1.0 - CONFIDENCE) / 2.0
    share = (
        float(betaincinv(events, others + 1.0, tail)) if events else 0.0,
        float(betaincinv(events + 1.0, others, 1.0 - tail)) if others else 1.0,
    )
    low, high = (end / (1.0 - end) * other_samples / samples if end < 1.0 else math.inf for end in share)
    return low, high
