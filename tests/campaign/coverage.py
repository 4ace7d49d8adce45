"""How often the 95 % intervals of studies cover the true value: the table of docs/studies.md.

``python -m tests.campaign.coverage`` prints it, from samples of distributions whose means and
medians are known.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from scipy import stats

from star_report.estimates import means, median

TRIALS: Final = 10_000
SIZES: Final = (5, 10, 19, 20, 40, 100)
DISTRIBUTIONS: Final[Mapping[str, Any]] = {
    "normal": stats.norm(3, 2),
    "uniform": stats.uniform(1, 2),
    "exponential": stats.expon(),
    "log-normal, sigma 1": stats.lognorm(1),
    "differences of 0 and 1": stats.rv_discrete(values=([-1, 0, 1], [0.1, 0.5, 0.4])),
    "Poisson counts, mean 0.5": stats.poisson(0.5),
    "Poisson counts, mean 5": stats.poisson(5),
    "clustered counts, mean 2, variance 10": stats.nbinom(0.5, 0.2),
    "outcomes, 90 % completed": stats.bernoulli(0.9),
}


def mean_coverage(distribution: Any, n: int, trials: int, *, signed: bool = False) -> float:
    """Return the share of samples whose interval of the mean covers that of the distribution.

    Samples without an interval, since all their values are equal, count as not covered.
    """
    samples = distribution.rvs(size=(trials, n), random_state=np.random.default_rng(n)).tolist()
    if distribution is DISTRIBUTIONS["outcomes, 90 % completed"]:
        samples = [[bool(value) for value in sample] for sample in samples]
    true = float(distribution.mean())
    return float(np.mean([of.low <= true <= of.high for of in means(samples, signed=signed)]))


def median_coverage(distribution: Any, n: int, trials: int) -> float:
    """Return the share of samples whose interval of the median covers that of the distribution."""
    samples = distribution.rvs(size=(trials, n), random_state=np.random.default_rng(n)).tolist()
    true = float(distribution.median())
    return float(np.mean([of.low <= true <= of.high for of in map(median, samples)]))


def main() -> None:
    """Print the table."""
    print(f"| mean of | {' | '.join(f'n = {n}' for n in SIZES)} |")
    print("|---" * (1 + len(SIZES)) + "|")
    for name, distribution in DISTRIBUTIONS.items():
        signed = name.startswith("differences")
        row = [mean_coverage(distribution, n, TRIALS, signed=signed) for n in SIZES]
        print(f"| {name} | {' | '.join(f'{share:.1%}' for share in row)} |", flush=True)
    for name in ("normal", "log-normal, sigma 1"):
        row = [median_coverage(DISTRIBUTIONS[name], max(n, 6), TRIALS) for n in SIZES]
        print(f"| median, {name} (n = 6 at least) | {' | '.join(f'{s:.1%}' for s in row)} |")


if __name__ == "__main__":
    main()
