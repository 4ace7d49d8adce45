"""What the figures of a report share, as Plotly describes them: data and layout."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from star_core import Array

Figure: TypeAlias = dict[str, Any]

# The qualitative palette of Okabe and Ito, which people with colour blindness can distinguish; its
# black and its yellow are darker and lighter here, to be seen on white and on black.
PALETTE: Final = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#777777", "#A08C00",
)  # fmt: skip
ALARM: Final = "#d32f2f"
MAX_POINTS: Final = 1500  # of a line


def colour(i: int) -> str:
    """Return the colour of agent `i`."""
    return PALETTE[i % len(PALETTE)]


def line(x: Array, y: Array, name: str, paint: str, group: str = "") -> Figure:
    """Return a line, thinned out to `MAX_POINTS`."""
    step = max(1, -(-len(x) // MAX_POINTS))
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.asarray(x[::step], np.float32),
        "y": np.asarray(y[::step], np.float32),
        "name": name,
        "line": {"color": paint, "width": 1.6},
        "legendgroup": group,
    }


def dotted(of: Figure) -> Figure:
    """Return a line as a thin dotted one that the legend does not list."""
    return of | {"line": of["line"] | {"dash": "dot", "width": 1}, "showlegend": False}


def crosses(points: Sequence[tuple[float, float, str]], name: str) -> Figure:
    """Return red crosses at x and y, with texts that appear under the pointer."""
    x, y, texts = zip(*points, strict=True)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": list(x),
        "y": list(y),
        "text": list(texts),
        "hovertemplate": "%{text}<extra></extra>",
        "name": name,
        "marker": {"symbol": "x", "size": 9, "color": ALARM},
    }


def over_time(lines: Sequence[Figure], axis: str, height: float | None = None) -> Figure:
    """Return a figure over mission time, with a dashed line at a `height`."""
    level = {
        "type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": height, "y1": height,
        "line": {"color": ALARM, "dash": "dash", "width": 1},
    }  # fmt: skip
    return {
        "data": list(lines),
        "layout": {
            "xaxis": {"title": {"text": "mission time (s)"}},
            "yaxis": {"title": {"text": axis}, "rangemode": "tozero"},
            "shapes": [] if height is None else [level],
            "height": 300,
        },
    }
