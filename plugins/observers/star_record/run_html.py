"""A recorded flight in a notebook: its figures, and a view from above."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from star_core.toolkit import number_at

if TYPE_CHECKING:
    from star_core import Run

WIDTH: Final = 320  # px
MAX_POINTS: Final = 400  # of a track
COLOURS: Final = ("#2a78c2", "#d95f02", "#1b9e77", "#a6398f", "#b58900", "#c23b3b")


def facts(summary: Mapping[str, Any]) -> dict[str, str]:
    """Return the figures of a flight, as text by label."""
    collisions = summary["collisions"]["agent_agent"] + summary["collisions"]["agent_obstacle"]
    lengths = {key: number_at(summary, key) for key in summary if key.endswith("_m")}
    reason = f": {summary['reason']}" if summary["reason"] else ""
    return {
        "outcome": summary["outcome"] + reason,
        "flight": f"{summary['flight_time_s']:.1f} s, {len(summary['agents'])} agents",
        "collisions": str(collisions),
        **{
            key.removesuffix("_m").replace("_", " "): f"{value:.3f} m"
            for key, value in lengths.items()
            if value is not None
        },
    }


def html(run: Run) -> str:
    """Return a table of the figures, and the tracks in the world as a picture."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(label)}</th><td>{escape(text)}</td></tr>"
        for label, text in {**facts(run.summary), "record": str(run.folder)}.items()
    )
    name = escape(str(run.summary["mission"]))
    return f"<b>{name}</b><table>{rows}</table>{_picture(run)}"


def _picture(run: Run) -> str:
    """Return an SVG of fence, obstacles and tracks from above, x to the right, y up."""
    low, high = (np.asarray(corner)[:2] for corner in (run.world.fence.low, run.world.fence.high))
    width, height = (high - low).tolist()
    shapes = "".join([*_obstacles(run), *_tracks(run)])
    box = f"{low[0]:.2f} {-high[1]:.2f} {width:.2f} {height:.2f}"
    style = f"fill='none' stroke-width='{width / 150:.3f}'"
    size = f"width='{WIDTH}' height='{WIDTH * height / width:.0f}'"
    border = "style='border:1px solid #888;background:white'"
    return f"<svg {size} viewBox='{box}' {border}><g {style}>{shapes}</g></svg>"


def _obstacles(run: Run) -> Iterator[str]:
    for colour, obstacles in (("#e8e8e8", run.world.virtual), ("#bbb", run.world.obstacles)):
        for obstacle in obstacles:
            for outline in obstacle.polygons:
                yield f"<polygon points='{_points(np.array(outline))}' fill='{colour}'/>"


def _tracks(run: Run) -> Iterator[str]:
    position = run.arrays.get("truth_position", run.arrays.get("estimate_position"))
    if position is None:
        return
    for row, name in enumerate(run.agents):
        track = position[:: max(1, len(position) // MAX_POINTS), row, :2]
        track = track[np.isfinite(track).all(axis=1)]
        colour = COLOURS[row % len(COLOURS)]
        title = f"<title>{escape(name)}</title>"
        yield f"<polyline points='{_points(track)}' stroke='{colour}'>{title}</polyline>"


def _points(corners: Any) -> str:
    """Return corners, (K, 2) m, as points of an SVG, in which y points down."""
    return " ".join(f"{x:.3f},{-y:.3f}" for x, y in corners.tolist())
