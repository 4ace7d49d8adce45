"""Means, medians, shares and counts of samples, with their 95 % intervals, and corrected p-values.

The unit is a run of a study. Every interval is that of scipy's distributions or of its bootstrap.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from functools import cache
from typing import Final, NamedTuple

import numpy as np
from scipy import stats

from star_core import Array

CONFIDENCE: Final = 0.95
MIN_SAMPLE: Final = 5  # runs, below which there is no interval
MIN_BOOTSTRAP: Final = 20  # runs, below which BCa intervals are too narrow
RESAMPLES: Final = 1999
BATCH: Final = 2_000_000  # values that are resampled at a time
ROUNDING: Final = 1e-12  # of a value
DISPERSED: Final = 0.05  # p-value of the index of dispersion, below which counts are not Poisson


class Estimate(NamedTuple):
    """An estimate from a sample, with its 95 % interval.

    Attributes:
        n: Sample size.
        value: Mean, median or share.
        std: Standard deviation of the sample (n - 1); NaN if n is 1.
        low: Lower end of the interval; NaN if there is none.
        high: Upper end of the interval; NaN if there is none.
        method: Of the interval: ``t``, ``BCa``, ``Wilson``, ``Poisson`` or ``order``; empty without
            one, since the sample is smaller than `MIN_SAMPLE` or all its values are equal.
    """

    n: int
    value: float
    std: float
    low: float = math.nan
    high: float = math.nan
    method: str = ""


def means(samples: Sequence[Sequence[float]], *, signed: bool = False) -> list[Estimate]:
    """Return the mean of each sample; none of them is empty.

    Booleans are a share, with Wilson's interval (JASA 22, 1927). Integers from 0 up are counts,
    with the exact interval of a Poisson distribution (Garwood, Biometrika 28, 1936), unless they
    vary more than such counts do by the index of dispersion. The interval of other numbers is
    Student's t below `MIN_BOOTSTRAP` values, and from there on the bias-corrected and accelerated
    bootstrap (Efron, JASA 82, 1987) where it is defined. It ends at 0 if no value is negative.

    Args:
        samples: Values of runs.
        signed: Whether they are differences: no counts, and negative even if these are not.
    """
    intervals = [_interval(sample, signed=signed) for sample in samples]
    by_size: dict[int, list[int]] = {}
    for i, (sample, interval) in enumerate(zip(samples, intervals, strict=True)):
        if interval is not None and interval[2] == "t" and len(sample) >= MIN_BOOTSTRAP:
            by_size.setdefault(len(sample), []).append(i)
    for indices in by_size.values():
        lows, highs = bootstrap(np.array([samples[i] for i in indices], float))
        for i, low, high in zip(indices, lows.tolist(), highs.tolist(), strict=True):
            if math.isfinite(low + high):
                intervals[i] = (low, high, "BCa")
    estimates = []
    for sample, interval in zip(samples, intervals, strict=True):
        values = np.array(sample, float)
        std = float(values.std(ddof=1)) if len(values) > 1 else math.nan
        low, high, method = interval or (math.nan, math.nan, "")
        if method and not signed and values.min() >= 0:
            low = max(0.0, low)
        estimates.append(Estimate(len(values), float(values.mean()), std, low, high, method))
    return estimates


def _interval(sample: Sequence[float], *, signed: bool) -> tuple[float, float, str] | None:
    """Return the interval of a mean, without the bootstrap, and its method; None if none."""
    n = len(sample)
    if n < MIN_SAMPLE:
        return None
    if not signed and all(isinstance(value, bool) for value in sample):
        return *wilson(sum(map(bool, sample)), n), "Wilson"
    counts = not signed and all(isinstance(value, int) and value >= 0 for value in sample)
    if counts and not any(sample):
        return *poisson(0, n), "Poisson"
    values = np.array(sample, float)
    if _equal(values):
        return None
    if counts and not _dispersed(values):
        return *poisson(int(values.sum()), n), "Poisson"
    low, high = student(values)
    return float(low), float(high), "t"


def student(values: Array) -> tuple[Array, Array]:
    """Return the interval of the mean by Student's t distribution (Biometrika 6, 1908).

    Args:
        values: (..., n) samples.

    Returns:
        (...) lower and upper ends.
    """
    n = values.shape[-1]
    error = values.std(axis=-1, ddof=1) / math.sqrt(n)
    half = stats.t.ppf((1 + CONFIDENCE) / 2, n - 1) * error
    mean = values.mean(axis=-1)
    return mean - half, mean + half


def bootstrap(values: Array) -> tuple[Array, Array]:
    """Return the BCa interval of the mean, NaN where it is not defined; shapes as `student`.

    The same values always have the same interval: the resamples are those of one seed.
    """
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of samples in which it is not defined
        result = stats.bootstrap(
            (values,),
            np.mean,
            axis=-1,
            n_resamples=RESAMPLES,
            batch=max(1, BATCH // values.size),
            confidence_level=CONFIDENCE,
            method="BCa",
            rng=np.random.default_rng(0),
        )
    interval = result.confidence_interval
    return np.asarray(interval.low), np.asarray(interval.high)


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Return Wilson's interval of a share of `n` runs."""
    low, high = stats.binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return float(low), float(high)


def poisson(events: int, n: int) -> tuple[float, float]:
    """Return the exact interval of the mean of Poisson counts, from their sum over `n` runs.

    >>> poisson(0, 10)[0], round(poisson(0, 10)[1], 4)
    (0.0, 0.3689)
    """
    tail = (1 - CONFIDENCE) / 2
    low = float(stats.chi2.ppf(tail, 2 * events)) / 2 if events else 0.0
    return low / n, float(stats.chi2.isf(tail, 2 * events + 2)) / 2 / n


def _equal(values: Array) -> bool:
    """Whether values are the same but for rounding."""
    return bool(np.ptp(values) <= ROUNDING * np.abs(values).max())


def _dispersed(counts: Array) -> bool:
    """Whether counts vary more than those of a Poisson distribution, by the index of dispersion."""
    index = counts.var(ddof=1) / counts.mean()
    return bool(stats.chi2.sf((len(counts) - 1) * index, len(counts) - 1) < DISPERSED)


@cache
def _rank(n: int) -> int:
    """Return the rank, from 1, of the value at which the interval of a median begins; 0: none."""
    return int(stats.binom.ppf((1 - CONFIDENCE) / 2, n, 0.5))


def median(sample: Sequence[float]) -> Estimate:
    """Return the median of a sample, whose interval is between two of its values.

    It holds for any distribution, and needs six values.
    """
    values = np.sort(np.array(sample, float))
    n, rank = len(values), _rank(len(values))
    std = float(values.std(ddof=1)) if n > 1 else math.nan
    middle = float(np.median(values))
    if n < MIN_SAMPLE or not rank or _equal(values):
        return Estimate(n, middle, std)
    return Estimate(n, middle, std, float(values[rank - 1]), float(values[n - rank]), "order")


def p_value(differences: Sequence[float]) -> float | None:
    """Return the p-value of paired differences by Student's t; None below `MIN_SAMPLE`.

    If none exceeds 1 and all are whole, as those of outcomes, or if all are equal, it is that of
    the sign test, which is McNemar's exact test (Psychometrika 12, 1947) for outcomes.
    """
    values = np.array(differences, float)
    n = len(values)
    if n < MIN_SAMPLE:
        return None
    if set(values.tolist()) <= {-1.0, 0.0, 1.0} or _equal(values):
        changed = int(np.count_nonzero(values))
        return float(stats.binomtest(int((values > 0).sum()), changed).pvalue) if changed else 1.0
    t = values.mean() / (values.std(ddof=1) / math.sqrt(n))
    return float(2 * stats.t.sf(abs(t), n - 1))


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Return p-values corrected for their number (Holm, Scand. J. Statist. 6, 1979).

    >>> holm([0.01, None, 0.04, 0.03])
    [0.03, None, 0.06, 0.06]
    """
    order = sorted((p, i) for i, p in enumerate(p_values) if p is not None)
    corrected: list[float | None] = [None] * len(p_values)
    highest = 0.0
    for rank, (p, i) in enumerate(order):
        highest = max(highest, min(1.0, (len(order) - rank) * p))
        corrected[i] = highest
    return corrected
