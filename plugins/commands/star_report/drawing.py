"""Figures of a study as SVG: the runs of each condition, and their mean with its interval."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from star_report.estimates import Estimate

WIDTH: Final = 640  # px, of a file
MARGIN: Final = 0.06  # of the width, at each side
ROW: Final = 58  # px
LABEL, POINTS, MEAN = 16, 31, 46  # px, from the top of a row to their baseline or middle
BAND: Final = 7  # px, half the height in which points are spread
BARS: Final = 60  # of a histogram
MAX_POINTS: Final = 100  # of a row, above which it has a histogram
MAX_LINES: Final = 1500  # between runs of the same seed, above which there are none
TICKS: Final = 6
STYLE: Final = (
    "svg.study{font:13px system-ui,sans-serif;fill:currentColor}"
    ".study .grid{stroke:currentColor;opacity:.15}.study .pair{stroke:#9aa0a6;opacity:.5}"
    ".study .run{fill:#56B4E9}.study .mean{stroke:#0072B2;stroke-width:2.5}"
    ".study .dot{fill:#0072B2}.study .note{font-size:12px}"
    ".study text{paint-order:stroke;stroke:var(--paper,#fff);stroke-width:4px}"
)


class Group(NamedTuple):
    """A row of a figure.

    Attributes:
        label: Its name.
        values: Values of its runs, by the text that the pointer shows.
        seeds: What runs of other rows are the same runs, in the order of `values`.
        mean: Their mean; None without values.
    """

    label: str
    values: Sequence[float]
    seeds: Sequence[object]
    mean: Estimate | None


class Scale(NamedTuple):
    """Positions along the width of a figure: percent of it or, in a file, px.

    Attributes:
        low: Value at the left margin.
        high: Value at the right margin.
        width: Of a file, px, or None.
    """

    low: float
    high: float
    width: int | None

    def at(self, value: float) -> str:
        """Return the position of a value."""
        return self._length(MARGIN + self._share(value - self.low))

    def length(self, difference: float) -> str:
        """Return the length of a difference of values."""
        return self._length(self._share(difference))

    def _share(self, difference: float) -> float:
        return (1 - 2 * MARGIN) * difference / (self.high - self.low)

    def _length(self, share: float) -> str:
        return f"{share:.2%}" if self.width is None else f"{share * self.width:.1f}"


def figure(title: str, groups: Sequence[Group], width: int | None = None) -> str:
    """Return a figure with a row for each group, from top to bottom.

    Args:
        title: What is measured, along the axis at the bottom.
        groups: Rows, whose values are not all equal; those of many runs are histograms.
        width: Of a file, px; None is for a page, whose width it has.
    """
    spread = [value for group in groups for value in _extent(group)]
    low, high = min(spread), max(spread)

    x = Scale(low, high, width)
    bottom = ROW * len(groups) + 6
    parts = [*_axis(x, bottom)]
    few = all(len(group.values) <= MAX_POINTS for group in groups)
    if few and sum(len(group.values) for group in groups) <= MAX_LINES:
        parts += _pairs(x, groups)
    for i, group in enumerate(groups):
        parts += _row(x, group, ROW * i)
    parts.append(
        f'<text class="note" x="{x.at((low + high) / 2)}" y="{bottom + 36}" text-anchor="middle">'
        f"{escape(title)}</text>"
    )
    height = bottom + 44
    size = 'width="100%"' if width is None else f'width="{width}" viewBox="0 0 {width} {height}"'
    style = "" if width is None else f"<style>{STYLE}</style>"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="study" role="img" {size} '
        f'height="{height}" aria-label="{escape(title)}">{style}{"".join(parts)}</svg>'
    )


def _extent(group: Group) -> list[float]:
    values = [min(group.values), max(group.values)] if group.values else []
    ends = [group.mean.low, group.mean.high] if group.mean is not None else []
    return [*values, *(end for end in ends if math.isfinite(end))]


def _axis(x: Scale, bottom: int) -> Iterator[str]:
    """Yield grid lines and their numbers."""
    for tick in ticks(x.low, x.high):
        at = x.at(tick)
        yield f'<line class="grid" x1="{at}" x2="{at}" y1="0" y2="{bottom}"/>'
        yield (
            f'<text class="note" x="{at}" y="{bottom + 16}" text-anchor="middle">{tick:.6g}</text>'
        )


def ticks(low: float, high: float) -> list[float]:
    """Return round numbers in a range.

    >>> ticks(0.03, 0.52)
    [0.1, 0.2, 0.3, 0.4, 0.5]
    """
    rough = (high - low) / TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [float(f"{k * step:.12g}") for k in range(first, last + 1)]


def _pairs(x: Scale, groups: Sequence[Group]) -> Iterator[str]:
    """Yield lines between runs of one seed in rows that follow each other."""
    for i, (upper, lower) in enumerate(pairwise(groups)):
        below = dict(zip(lower.seeds, lower.values, strict=True))
        for seed, value in zip(upper.seeds, upper.values, strict=True):
            if seed in below:
                y = ROW * i + POINTS
                yield (
                    f'<line class="pair" x1="{x.at(value)}" y1="{y}" x2="{x.at(below[seed])}" '
                    f'y2="{y + ROW}"/>'
                )


def _row(x: Scale, group: Group, top: int) -> Iterator[str]:
    """Yield the marks of a group."""
    yield f'<text x="4" y="{top + LABEL}">{escape(group.label)}</text>'
    if len(group.values) > MAX_POINTS:
        yield from _histogram(x, group.values, top + POINTS + BAND)
    else:
        for k, (value, seed) in enumerate(zip(group.values, group.seeds, strict=True)):
            y = top + POINTS + BAND * (2 * k / max(1, len(group.values) - 1) - 1)
            yield (
                f'<circle class="run" cx="{x.at(value)}" cy="{y:.1f}" r="3"><title>'
                f"{escape(str(seed))}: {value:.4g}</title></circle>"
            )
    mean, y = group.mean, top + MEAN
    if mean is None:
        return
    if mean.method:
        yield f'<line class="mean" x1="{x.at(mean.low)}" x2="{x.at(mean.high)}" y1="{y}" y2="{y}"/>'
    interval = f" [{mean.low:.4g}, {mean.high:.4g}]" if mean.method else ""
    yield (
        f'<circle class="dot" cx="{x.at(mean.value)}" cy="{y}" r="4.5"><title>mean '
        f"{mean.value:.4g}{interval}, n {mean.n}</title></circle>"
    )


def _histogram(x: Scale, values: Sequence[float], bottom: int) -> Iterator[str]:
    """Yield bars whose heights are numbers of runs; the highest one has the whole height."""
    counts, edges = np.histogram(values, bins=BARS, range=(x.low, x.high))
    for count, left, right in zip(
        counts.tolist(), edges.tolist(), edges.tolist()[1:], strict=False
    ):
        if count:
            height = max(1.0, 2 * BAND * count / counts.max())
            yield (
                f'<rect class="run" x="{x.at(left)}" width="{x.length(right - left)}" '
                f'y="{bottom - height:.1f}" height="{height:.1f}"><title>{left:.4g} to '
                f"{right:.4g}: {count} runs</title></rect>"
            )
