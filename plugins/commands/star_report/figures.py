"""The figures of a report, as Plotly describes them: data and layout."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
import shapely

from star_core import Array, Obstacle, Run, box_edges, obstacle_meshes
from star_report.series import Nearest, airborne, clearance, errors, positions, separation

Figure: TypeAlias = dict[str, Any]

# The qualitative palette of Okabe and Ito, which people with colour blindness can distinguish.
PALETTE: Final = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442",
)  # fmt: skip
OBSTACLE, FENCE, LANDMARK, TARGET = "#9aa0a6", "#3c8d40", "#1f4e9c", "#c77700"
CONTACT: Final = 0.12  # m between the centres of two agents that touch
REPLAY_RATE: Final = 10.0  # Hz
MAX_POINTS: Final = 3000  # of a line


def colour(i: int) -> str:
    """Return the colour of agent `i`."""
    return PALETTE[i % len(PALETTE)]


def top_view(run: Run) -> Figure:
    """Return the flight from above: world, true and estimated paths."""
    true = positions(run)
    flying = airborne(run)
    data: list[Figure] = []
    for i, name in enumerate(run.agents):
        path = np.where(flying[:, i, None], true[:, i], np.nan)
        data.append(_line(path[:, 0], path[:, 1], name, colour(i), group=name))
        if "truth_position" in run.arrays:
            path = np.where(flying[:, i, None], run.arrays["estimate_position"][:, i], np.nan)
            dotted = _line(path[:, 0], path[:, 1], f"{name}, estimate", colour(i), group=name)
            data.append(dotted | {"line": {"color": colour(i), "dash": "dot", "width": 1}})
        ends = true[[0, -1], i]
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": ends[:, 0],
                "y": ends[:, 1],
                "marker": {"color": colour(i), "symbol": ["circle-open", "square"], "size": 9},
                "text": [f"{name}: start", f"{name}: end"],
                "hovertemplate": "%{text}<br>%{x:.2f}, %{y:.2f} m<extra></extra>",
                "legendgroup": name,
                "showlegend": False,
            }
        )
    for label, tags, paint, symbol in (
        ("landmark", run.world.landmarks, LANDMARK, "square"),
        ("target", run.world.targets, TARGET, "star"),
    ):
        if tags:
            data.append(
                {
                    "type": "scatter",
                    "mode": "markers+text",
                    "x": [tag.position[0] for tag in tags],
                    "y": [tag.position[1] for tag in tags],
                    "text": [str(tag.id) for tag in tags],
                    "hovertext": [f"{tag.of} ({tag.id})" for tag in tags],
                    "textposition": "top center",
                    "textfont": {"size": 9, "color": paint},
                    "marker": {"color": paint, "symbol": symbol, "size": 8},
                    "name": f"{label}s",
                }
            )
    for found, label in (
        (separation(run), "closest approach"),
        (clearance(run), "least clearance"),
    ):
        if found.tick is not None:
            data.append(_mark(found, label, run))
    low, high = run.world.fence.low, run.world.fence.high
    shapes = [
        {
            "type": "rect",
            "x0": low[0], "y0": low[1], "x1": high[0], "y1": high[1],
            "line": {"color": FENCE, "dash": "dash"}, "layer": "below",
        },
        *(_outline(polygon) for obstacle in run.world.obstacles for polygon in obstacle.polygons),
    ]  # fmt: skip
    names = [
        {
            "x": point.x, "y": point.y, "text": obstacle.name, "showarrow": False,
            "font": {"size": 10, "color": "#444"},
        }
        for obstacle in run.world.obstacles
        for point in [shapely.Polygon(obstacle.polygons[0]).representative_point()]
    ]  # fmt: skip
    return {
        "data": data,
        "layout": {
            "xaxis": {"title": {"text": "x (m)"}, "zeroline": False, "constrain": "domain"},
            "yaxis": {
                "title": {"text": "y (m)"}, "zeroline": False, "scaleanchor": "x",
                "scaleratio": 1,
            },
            "shapes": shapes, "annotations": names, "height": 560,
        },
    }  # fmt: skip


def replay(run: Run) -> Figure:
    """Return the flight in three dimensions; the page moves the agents.

    ``path`` holds the positions at `REPLAY_RATE`, (frames, N, 3) in a row, and ``time`` their
    mission times; the last traces are the trail of each agent, and all agents.
    """
    time = run.arrays["time"]
    frames = np.arange(time[0], time[-1] + 1e-9, 1 / REPLAY_RATE)
    rows = np.clip(np.searchsorted(time, frames), 0, len(time) - 1)
    path = positions(run)[rows]
    low, high = (np.array(corner) for corner in (run.world.fence.low, run.world.fence.high))
    data: list[Figure] = [_fence(low, high)]
    data += [mesh for obstacle in run.world.obstacles for mesh in _prisms(obstacle)]
    for tags, paint in ((run.world.landmarks, LANDMARK), (run.world.targets, TARGET)):
        if tags:
            place = np.array([tag.position for tag in tags])
            data.append(
                {
                    "type": "scatter3d",
                    "mode": "markers+text",
                    **_xyz(place),
                    "text": [str(tag.id) for tag in tags],
                    "hovertext": [f"{tag.of} ({tag.id})" for tag in tags],
                    "textfont": {"size": 9, "color": paint},
                    "marker": {"size": 3, "color": paint, "symbol": "square"},
                    "hoverinfo": "text",
                }
            )
    data += [
        {
            "type": "scatter3d",
            "mode": "lines",
            "x": [],
            "y": [],
            "z": [],
            "line": {"color": colour(i), "width": 3},
            "hoverinfo": "skip",
        }
        for i in range(len(run.agents))
    ]
    data.append(
        {
            "type": "scatter3d",
            "mode": "markers+text",
            **_xyz(path[0]),
            "text": list(run.agents),
            "textposition": "top center",
            "marker": {"size": 5, "color": [colour(i) for i in range(len(run.agents))]},
            "hoverinfo": "text",
        }
    )
    size = high - low
    return {
        "data": data,
        "layout": {
            "showlegend": False,
            "height": 560,
            "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
            "scene": {
                **{
                    f"{axis}axis": {
                        "title": {"text": f"{axis} (m)"},
                        "range": [float(low[k]), float(high[k])],
                    }
                    for k, axis in enumerate("xyz")
                },
                "aspectmode": "manual",
                "aspectratio": {
                    axis: float(1.5 * size[k] / size.max()) for k, axis in enumerate("xyz")
                },
                "camera": {"eye": {"x": -1.2, "y": -1.4, "z": 1.2}},
            },
        },
        "agents": len(run.agents),
        "path": np.asarray(path, np.float32).ravel(),
        "time": np.asarray(frames, np.float32),
    }


def over_time(run: Run) -> Iterator[tuple[str, str, Figure]]:
    """Yield title, caption and figure of what is plotted over time."""
    time = run.arrays["time"]
    found = errors(run)
    if found is not None:
        error, bound = found
        lines = [line for i, name in enumerate(run.agents) for line in (
            _line(time, error[:, i], name, colour(i), group=name),
            _line(time, bound[:, i], f"{name}, 3 std", colour(i), group=name)
            | {"line": {"color": colour(i), "dash": "dot", "width": 1}},
        )]  # fmt: skip
        yield (
            "Position error",
            "Distance between estimate and ground truth in the air. Dotted: three standard "
            "deviations by the estimate's covariance.",
            _over_time(lines, "error (m)"),
        )
    for title, caption, nearest, name in (
        (
            "Separation",
            "Distance between the two nearest agents in the air. Dashed: contact.",
            separation(run),
            "nearest two agents",
        ),
        (
            "Clearance",
            "Distance from the nearest obstacle to an agent in the air.",
            clearance(run),
            "nearest obstacle",
        ),
    ):
        if nearest.tick is not None:
            figure = _over_time(
                [
                    _line(time, nearest.distance, name, colour(0)),
                    _mark(nearest, "closest", run, time),
                ],
                "distance (m)",
            )
            if title == "Separation":
                figure["layout"]["shapes"] = [_level(CONTACT)]
            yield title, caption, figure
    for title, caption, array, axis in (
        ("Altitude", "z of each agent in the map.", positions(run)[..., 2], "z (m)"),
        ("Battery", "Battery voltage of each agent.", run.arrays["battery"], "voltage (V)"),
    ):
        if np.isfinite(array).any():
            lines = [
                _line(time, array[:, i], name, colour(i), group=name)
                for i, name in enumerate(run.agents)
            ]
            figure = _over_time(lines, axis)
            figure["layout"]["yaxis"]["rangemode"] = "normal" if title == "Battery" else "tozero"
            yield title, caption, figure


def steps(run: Run) -> Figure:
    """Return when each agent executed which step."""
    verbs = list(dict.fromkeys(step["verb"] for step in run.summary["steps"]))
    end = float(run.arrays["time"][-1])
    data = []
    for k, verb in enumerate(verbs):
        bars = [
            (agent, step["begun_s"], step["ended_s"] if step["ended_s"] is not None else end, step)
            for step in run.summary["steps"]
            if step["verb"] == verb
            for agent in step["agents"]
        ]
        data.append(
            {
                "type": "bar",
                "orientation": "h",
                "name": verb,
                "y": [bar[0] for bar in bars],
                "base": [bar[1] for bar in bars],
                "x": [bar[2] - bar[1] for bar in bars],
                "text": [bar[3].get("location", "") for bar in bars],
                "hovertemplate": f"%{{y}}: {verb}<br>%{{text}}<br>%{{base:.2f}} s<extra></extra>",
                "textposition": "none",
                "marker": {"color": colour(k), "line": {"color": "white", "width": 1}},
            }
        )
    return {
        "data": data,
        "layout": {
            "barmode": "overlay",
            "xaxis": {"title": {"text": "mission time (s)"}},
            "yaxis": {"autorange": "reversed", "type": "category"},
            "height": 130 + 28 * len(run.agents),
        },
    }


def compute(run: Run) -> Figure:
    """Return the computing time of each plugin."""
    spent: Mapping[str, float] = run.summary["compute_s"]
    names = sorted(spent, key=lambda name: spent[name])
    return {
        "data": [
            {
                "type": "bar",
                "orientation": "h",
                "y": [name.partition(" (")[0] for name in names],
                "x": [spent[name] for name in names],
                "marker": {"color": colour(0)},
                "hovertemplate": "%{y}: %{x:.3f} s<extra></extra>",
            }
        ],
        "layout": {
            "xaxis": {"title": {"text": "computing time (s)"}},
            "yaxis": {"automargin": True},
            "height": 120 + 22 * len(names),
        },
    }


def _over_time(lines: Sequence[Figure], axis: str) -> Figure:
    return {
        "data": list(lines),
        "layout": {
            "xaxis": {"title": {"text": "mission time (s)"}},
            "yaxis": {"title": {"text": axis}, "rangemode": "tozero"},
            "height": 300,
        },
    }


def _line(x: Array, y: Array, name: str, paint: str, group: str = "") -> Figure:
    step = max(1, len(x) // MAX_POINTS)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.asarray(x[::step], np.float32),
        "y": np.asarray(y[::step], np.float32),
        "name": name,
        "line": {"color": paint, "width": 1.6},
        "legendgroup": group,
    }


def _mark(found: Nearest, label: str, run: Run, time: Array | None = None) -> Figure:
    """Return a cross where two things came closest: in the top view, or over time."""
    tick = found.tick if found.tick is not None else 0
    distance = float(found.distance[tick])
    moment = float(run.arrays["time"][tick])
    x, y = found.position[:2] if time is None else (moment, distance)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [float(x)],
        "y": [float(y)],
        "name": label,
        "text": [f"{found.names}: {distance:.2f} m at {moment:.2f} s"],
        "hovertemplate": "%{text}<extra></extra>",
        "marker": {"symbol": "x", "size": 9, "color": "#b00020"},
    }


def _level(height: float) -> Figure:
    return {
        "type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": height, "y1": height,
        "line": {"color": "#b00020", "dash": "dash", "width": 1},
    }  # fmt: skip


def _outline(polygon: Sequence[tuple[float, float]]) -> Figure:
    corners = " L ".join(f"{x:g},{y:g}" for x, y in polygon)
    return {
        "type": "path", "path": f"M {corners} Z", "fillcolor": OBSTACLE, "opacity": 0.5,
        "line": {"color": OBSTACLE}, "layer": "below",
    }  # fmt: skip


def _fence(low: Array, high: Array) -> Figure:
    """Return the edges of the geofence: a line with gaps (NaN) between them."""
    edges = np.pad(
        box_edges(low.tolist(), high.tolist()), ((0, 0), (0, 1), (0, 0)), constant_values=np.nan
    )
    return {
        "type": "scatter3d",
        "mode": "lines",
        **_xyz(edges.reshape(-1, 3)),
        "line": {"color": FENCE, "width": 2},
        "hoverinfo": "skip",
    }


def _prisms(obstacle: Obstacle) -> Iterator[Figure]:
    for vertices, faces in obstacle_meshes(obstacle):
        yield {
            "type": "mesh3d",
            **_xyz(vertices),
            **dict(zip("ijk", faces.T, strict=True)),
            "color": OBSTACLE,
            "opacity": 0.6,
            "flatshading": True,
            "hovertemplate": f"{obstacle.name}<extra></extra>",
        }


def _xyz(points: Array) -> Figure:
    return {axis: np.asarray(points[:, k], np.float32) for k, axis in enumerate("xyz")}
