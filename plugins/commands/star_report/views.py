"""Views of a flight: from above, and in three dimensions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import shapely

from star_core import AgentPhase, Array, Obstacle, Run, Tag
from star_core.toolkit import box_edges, obstacle_meshes
from star_report.figures import ALARM, Figure, colour, crosses, dotted, line
from star_report.series import airborne, clearance, positions, separation

OBSTACLE, FENCE, LANDMARK, TARGET = "#9aa0a6", "#3c8d40", "#4a7fc1", "#c77700"
REPLAY_RATE: Final = 10.0  # Hz
MIN_SHAPE: Final = 0.07  # m, from the middle of a drawn drone to its rotors
SHAPE_SHARE: Final = 0.02  # of the size of the room, which a drone is at least drawn with
MARGIN: Final = 0.1  # m, around the geofence
SOLID, VIRTUAL = 0.55, 0.15  # opacities of obstacles


def top_view(run: Run) -> Figure:
    """Return the flight from above: world, true and estimated paths."""
    true = positions(run)
    flying = airborne(run)
    data: list[Figure] = []
    for i, name in enumerate(run.agents):
        path = np.where(flying[:, i, None], true[:, i], np.nan)
        data.append(line(path[:, 0], path[:, 1], name, colour(i), group=name))
        if "truth_position" in run.arrays:
            path = np.where(flying[:, i, None], run.arrays["estimate_position"][:, i], np.nan)
            label = f"{name}, estimate"
            data.append(dotted(line(path[:, 0], path[:, 1], label, colour(i), group=name)))
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
                    "text": _labels(tags),
                    "hovertext": [f"{tag.of} ({tag.id})" for tag in tags],
                    "textposition": "top center",
                    "textfont": {"size": 9, "color": paint},
                    "marker": {"color": paint, "symbol": symbol, "size": 8},
                    "name": f"{label}s",
                }
            )
    for approach, label in (
        (separation(run), "closest approach"),
        (clearance(run), "least clearance"),
    ):
        if approach.tick is not None:
            points = [(x, y, approach.text) for x, y, _ in approach.between.tolist()]
            mark = crosses(points, f"{label}: {approach.least:.2f} m")
            data.append(mark | {"mode": "lines+markers", "line": {"color": ALARM, "width": 1}})
    low, high = run.world.fence.low, run.world.fence.high
    shapes = [
        {
            "type": "rect",
            "x0": low[0], "y0": low[1], "x1": high[0], "y1": high[1],
            "line": {"color": FENCE, "dash": "dash"}, "layer": "below",
        },
        *(
            _outline(polygon, opacity)
            for obstacle, opacity in _obstacles(run)
            for polygon in obstacle.polygons
        ),
    ]  # fmt: skip
    names = [
        {
            "x": point.x, "y": point.y, "text": obstacle.name, "showarrow": False,
            "font": {"size": 10},
        }
        for obstacle, _ in _obstacles(run)
        for point in [shapely.Polygon(obstacle.polygons[0]).representative_point()]
    ]  # fmt: skip
    return {
        "data": data,
        "layout": {
            "xaxis": {
                "title": {"text": "x (m)"}, "zeroline": False, "constrain": "domain",
                "range": [low[0] - MARGIN, high[0] + MARGIN],
            },
            "yaxis": {
                "title": {"text": "y (m)"}, "zeroline": False, "scaleanchor": "x",
                "scaleratio": 1, "range": [low[1] - MARGIN, high[1] + MARGIN],
            },
            "shapes": shapes, "annotations": names, "height": 560,
        },
    }  # fmt: skip


def replay(run: Run) -> Figure:
    """Return the flight in three dimensions; the page moves the agents.

    ``path`` holds the positions at `REPLAY_RATE`, (frames, N, 3) in a row, and ``time`` their
    mission times; ``here`` holds the estimated positions, and ``planned`` the index into ``points``
    of the planned path, (frames, N) in a row; ``shape`` is the outline of a drone. The last traces
    are the planned path of each agent, its trail and its drone, and the names of all agents.
    """
    time = run.arrays["time"]
    frames = np.arange(time[0], time[-1] + 1e-9, 1 / REPLAY_RATE)
    rows = np.clip(np.searchsorted(time, frames), 0, len(time) - 1)
    path = positions(run)[rows]
    low, high = (np.array(corner) for corner in (run.world.fence.low, run.world.fence.high))
    data: list[Figure] = [_fence(low, high)]
    data += [mesh for some in _obstacles(run) for mesh in _prisms(*some)]
    for name, tags, paint in (
        ("landmarks", run.world.landmarks, LANDMARK),
        ("targets", run.world.targets, TARGET),
    ):
        if tags:
            points = np.array([tag.position for tag in tags])
            data.append(
                {
                    "type": "scatter3d",
                    "mode": "markers+text",
                    "name": name,
                    **_xyz(points),
                    "text": _labels(tags),
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
            "line": {"color": colour(i)} | style,
            "hoverinfo": "skip",
        }
        for style in ({"width": 2, "dash": "dash"}, {"width": 3}, {"width": 6})
        for i in range(len(run.agents))
    ]
    data.append(
        {
            "type": "scatter3d",
            "mode": "text",
            **_xyz(path[0]),
            "text": list(run.agents),
            "textposition": "top center",
            "hoverinfo": "text",
        }
    )
    size = high - low
    shape = _quadrotor(max(MIN_SHAPE, SHAPE_SHARE * float(size.max())))
    numbers = np.stack([run.paths.current(i, frames) for i in range(len(run.agents))], axis=1)
    pursuing = np.isin(run.arrays["phase"][rows], (AgentPhase.TAKING_OFF, AgentPhase.FLYING))
    shown, planned = np.unique(np.where(pursuing, numbers, -1), return_inverse=True)
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
                "camera": {
                    "eye": {"x": -1.3, "y": -1.6, "z": 1.3},
                    "center": {"x": 0, "y": 0, "z": -0.25},
                },
            },
        },
        "agents": len(run.agents),
        "path": np.asarray(path, np.float32).ravel(),
        "here": np.asarray(run.arrays["estimate_position"][rows], np.float32).ravel(),
        "planned": planned.ravel().astype(np.int32),
        "points": [run.paths.points(n) if n >= 0 else [] for n in shown.tolist()],
        "shape": np.asarray(shape, np.float32).ravel(),
        "time": np.asarray(frames, np.float32),
    }


def _quadrotor(arm: float) -> Array:
    """Return the outline of a level drone, (K, 3) m: two crossed arms and a circle at each end.

    Args:
        arm: Length of an arm, m.
    """
    angles = np.linspace(0, 2 * np.pi, 13)
    circle = 0.6 * arm * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    gap, middle = np.full((1, 3), np.nan), np.zeros((1, 3))
    parts: list[Array] = []
    for quarter in np.pi * (0.25 + 0.5 * np.arange(4)):
        end = arm * np.array([[np.cos(quarter), np.sin(quarter), 0]])
        parts += [middle, end, gap, end + circle, gap]
    return np.concatenate(parts)


def _labels(tags: Sequence[Tag]) -> list[str]:
    """Return names of targets, and numbers of landmarks' tags, which have several."""
    names = [tag.of for tag in tags]
    return names if len(set(names)) == len(names) else [str(tag.id) for tag in tags]


def _obstacles(run: Run) -> Iterator[tuple[Obstacle, float]]:
    """Yield the obstacles with their opacities."""
    yield from ((obstacle, SOLID) for obstacle in run.world.obstacles)
    yield from ((obstacle, VIRTUAL) for obstacle in run.world.virtual)


def _outline(polygon: Sequence[tuple[float, float]], opacity: float) -> Figure:
    corners = " L ".join(f"{x:g},{y:g}" for x, y in polygon)
    return {
        "type": "path", "path": f"M {corners} Z", "fillcolor": OBSTACLE, "opacity": opacity,
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


def _prisms(obstacle: Obstacle, opacity: float) -> Iterator[Figure]:
    for vertices, faces in obstacle_meshes(obstacle):
        yield {
            "type": "mesh3d",
            **_xyz(vertices),
            **dict(zip("ijk", faces.T, strict=True)),
            "color": OBSTACLE,
            "opacity": opacity,
            "flatshading": True,
            "hovertemplate": f"{obstacle.name}<extra></extra>",
        }


def _xyz(points: Array) -> Figure:
    return {axis: np.asarray(points[:, k], np.float32) for k, axis in enumerate("xyz")}
