"""The world of a flight as objects of a page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from star_core import Tag, World
from star_core.toolkit import Beacon, box_edges, obstacle_meshes
from star_view.names import Name

if TYPE_CHECKING:
    from viser import SceneApi

FENCE: Final = (60, 141, 64)
OBSTACLE: Final = (190, 196, 204)
LANDMARK: Final = (31, 78, 156)
TARGET: Final = (199, 119, 0)
BEACON: Final = (123, 63, 160)
BEACON_SIZE: Final = 0.08  # m
VIEW: Final = 0.4  # m, length of the line in which a base station looks
ABOVE: Final = 0.05  # m, of a name over what it names
TAG_THICKNESS: Final = 0.01  # m
VIRTUAL: Final = 0.15  # opacity of virtual obstacles


def add_world(scene: SceneApi, world: World) -> list[Name]:
    """Add the floor, the geofence, obstacles, tags, base stations and anchors; return the names."""
    low, high = np.array(world.fence.low), np.array(world.fence.high)
    width, depth, _ = high - low
    centre = (low + high) / 2
    scene.add_grid("/floor", width=width, height=depth, cell_size=0.5, position=(*centre[:2], 0.0))
    add_lines(scene, "/fence", box_edges(world.fence.low, world.fence.high), FENCE, 1.5)
    names = []
    for obstacle, opacity in (
        *((obstacle, 0.55) for obstacle in world.obstacles),
        *((obstacle, VIRTUAL) for obstacle in world.virtual),
    ):
        for i, (vertices, faces) in enumerate(obstacle_meshes(obstacle)):
            scene.add_mesh_simple(
                f"/obstacles/{obstacle.name}/{i}", vertices, faces, color=OBSTACLE, opacity=opacity,
                flat_shading=True, side="double", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
        at = shapely.Polygon(obstacle.polygons[0]).representative_point()
        node = f"/obstacles/{obstacle.name}/name"
        names.append(Name(node, obstacle.name, (at.x, at.y, obstacle.height[1] + ABOVE)))
    names += _add_tags(scene, "landmarks", world.landmarks, LANDMARK)
    names += _add_tags(scene, "targets", world.targets, TARGET)
    for beacon in (*world.base_stations, *world.anchors):
        names.append(_add_beacon(scene, beacon, looks=beacon in world.base_stations))
    return names


def add_lines(
    scene: SceneApi,
    name: str,
    segments: NDArray[np.floating[Any]],
    color: tuple[int, int, int],
    width: float,
) -> Any:
    """Add line segments, (K, 2, 3) m, that are everywhere `width` px wide; return their handle."""
    return scene.add_line_segments(name, segments, color, thickness=width, thickness_units="screen")


def _add_beacon(scene: SceneApi, beacon: Beacon, *, looks: bool) -> Name:
    """Add a base station or an anchor, and in which direction it looks; return its name."""
    x, y, z, w = beacon.rotation
    name = f"/beacons/{beacon.name}"
    scene.add_box(
        name, color=BEACON, wxyz=(w, x, y, z), position=beacon.position,
        dimensions=(BEACON_SIZE,) * 3, cast_shadow=False, receive_shadow=False,
    )  # fmt: skip
    if looks:
        view = np.array([[(0.0, 0.0, 0.0), (VIEW, 0.0, 0.0)]])
        add_lines(scene, f"{name}/view", view, BEACON, 2.0)
    x, y, z = beacon.position
    return Name(f"{name}/label", beacon.name, (x, y, z + BEACON_SIZE))


def _add_tags(
    scene: SceneApi, kind: str, tags: Iterable[Tag], color: tuple[int, int, int]
) -> Iterator[Name]:
    """Add tags, and yield one name for those of each landmark or target."""
    groups: dict[str, list[Tag]] = {}
    for tag in tags:
        groups.setdefault(tag.of, []).append(tag)
        x, y, z, w = tag.rotation
        scene.add_box(
            f"/{kind}/{tag.of}/{tag.id}", color=color, wxyz=(w, x, y, z), position=tag.position,
            dimensions=(tag.size, tag.size, TAG_THICKNESS), cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
    for name, members in groups.items():
        numbers = ", ".join(str(tag.id) for tag in members)
        x, y, z = np.mean([tag.position for tag in members], axis=0)
        yield Name(f"/{kind}/{name}/label", f"{name} ({numbers})", (x, y, z + ABOVE))
