"""Measures of runs: read from their summaries, and aggregated over seeds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Any, Final

CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True)
class Spread:
    """Statistics of a sample.

    Attributes:
        n: Sample size.
        mean: Mean.
        sd: Standard deviation of the sample (n - 1); NaN if there are fewer than two.
        half: Half the width of the 95 % interval of the mean; NaN if there are fewer than two.
    """

    n: int
    mean: float
    sd: float
    half: float


def spread(values: Sequence[float]) -> Spread:
    """Return the statistics of a sample that is not empty.

    The interval is Student's (Biometrika 6(1), 1908): the mean ± t sd/√n, with t the 97.5 % point
    of the t distribution with n - 1 degrees of freedom.

    >>> round(spread([1.0, 2.0, 3.0]).half, 4)
    2.4841
    """
    n = len(values)
    if n == 1:
        return Spread(1, float(values[0]), math.nan, math.nan)
    from scipy.special import stdtrit

    sd = stdev(values)
    t = float(stdtrit(n - 1, (1 + CONFIDENCE) / 2))
    return Spread(n, fmean(values), sd, t * sd / math.sqrt(n))


def measured(summary: Mapping[str, Any] | None, path: str) -> Any:
    """Return the value at `path`, keys joined by dots; None if there is none.

    >>> measured({"position_mse_m2": {"mean": 0.2}}, "position_mse_m2.mean")
    0.2
    """
    value: Any = summary
    for key in path.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def numbers(values: Sequence[Any]) -> list[float]:
    """Return the finite numbers among some values; booleans count as 0 or 1."""
    found = (float(value) for value in values if isinstance(value, int | float))
    return [value for value in found if math.isfinite(value)]


def paths(summary: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Yield every path in a summary.

    >>> list(paths({"collisions": {"agent_agent": 0}, "reason": ""}))
    ['collisions', 'collisions.agent_agent', 'reason']
    """
    for key, value in summary.items():
        yield f"{above}{key}"
        if isinstance(value, Mapping):
            yield from paths(value, f"{above}{key}.")
