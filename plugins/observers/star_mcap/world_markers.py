"""The world of a mission as markers for RViz and Foxglove."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from star_core import Array, Obstacle, Scene
from star_core.toolkit import box_edges, obstacle_meshes
from star_mcap.messages import header, kind, point, pose, vector

GREY, GREEN, BLUE, ORANGE = (0.5, 0.5, 0.5), (0.2, 0.6, 0.2), (0.1, 0.3, 0.8), (0.9, 0.5, 0.1)
FAINT = (0.85, 0.85, 0.85)
THICKNESS = 0.005  # m: of tags
TEXT = 0.12  # m: height of letters
LINE = 0.02  # m: width of lines
OPACITY = 0.8


def world_markers(scene: Scene, time: int) -> Any:
    """Return the fence, obstacles, landmarks, targets and start poses as one MarkerArray."""
    markers = [_marker(time, i, spec) for i, spec in enumerate(_markers(scene))]
    return kind("visualization_msgs/MarkerArray")(markers)


def _markers(scene: Scene) -> Iterator[dict[str, Any]]:
    world, marker = scene.world, kind("visualization_msgs/Marker")
    yield {
        "ns": "fence",
        "type": marker.LINE_LIST,
        "scale": (LINE, 0.0, 0.0),
        "points": _points(box_edges(world.fence.low, world.fence.high)),
        "color": GREEN,
    }
    for ns, obstacle in (
        *(("obstacles", obstacle) for obstacle in world.obstacles),
        *(("virtual_obstacles", obstacle) for obstacle in world.virtual),
    ):
        yield {
            "ns": ns,
            "type": marker.TRIANGLE_LIST,
            "scale": (1.0, 1.0, 1.0),
            "points": _points(_triangles(obstacle)),
            "color": GREY if ns == "obstacles" else FAINT,
        }
    for ns, tags, color in (
        ("landmarks", world.landmarks, BLUE),
        ("targets", world.targets, ORANGE),
    ):
        for tag in tags:
            x, y, z = tag.position
            yield {
                "ns": ns,
                "type": marker.CUBE,
                "pose": pose(tag.position, tag.rotation),
                "scale": (tag.size, tag.size, THICKNESS),
                "color": color,
            }
            yield {
                "ns": f"{ns}_names",
                "type": marker.TEXT_VIEW_FACING,
                "pose": pose((x, y, z + TEXT)),
                "scale": (0.0, 0.0, TEXT),
                "text": f"{tag.of} ({tag.id})",
                "color": color,
            }
    for agent in scene.agents:
        x, y, z = agent.start
        yield {
            "ns": "starts",
            "type": marker.TEXT_VIEW_FACING,
            "pose": pose((x, y, z + TEXT / 2)),
            "scale": (0.0, 0.0, TEXT),
            "text": agent.name,
            "color": GREY,
        }


def _marker(time: int, number: int, spec: Mapping[str, Any]) -> Any:
    """Return a marker with the given fields; the others are empty."""
    nothing = np.zeros(0, np.uint8)
    return kind("visualization_msgs/Marker")(
        header=header(time),
        ns=spec["ns"],
        id=number,
        type=spec["type"],
        action=0,  # add
        pose=spec.get("pose") or pose((0.0, 0.0, 0.0)),
        scale=vector(spec["scale"]),
        color=kind("std_msgs/ColorRGBA")(*spec["color"], OPACITY),
        lifetime=kind("builtin_interfaces/Duration")(0, 0),  # until it is replaced
        frame_locked=False,
        points=spec.get("points", []),
        colors=[],
        texture_resource="",
        texture=kind("sensor_msgs/CompressedImage")(header(time), "", nothing),
        uv_coordinates=[],
        text=spec.get("text", ""),
        mesh_resource="",
        mesh_file=kind("visualization_msgs/MeshFile")("", nothing),
        mesh_use_embedded_materials=False,
    )


def _triangles(obstacle: Obstacle) -> Array:
    """Return the corners of an obstacle's triangles, (F, 3, 3) m."""
    return np.concatenate([vertices[faces] for vertices, faces in obstacle_meshes(obstacle)])


def _points(corners: Array) -> list[Any]:
    return [point(corner) for corner in corners.reshape(-1, 3).tolist()]
