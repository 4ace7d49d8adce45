"""The agents of a flight as objects of a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

import numpy as np
import viser
from numpy.typing import NDArray

from star_core import Agent, Array
from star_view.drone_mesh import frame_and_rear, front
from star_view.footprints import footprint
from star_view.snapshot import Snapshot
from star_view.world_scene import add_lines

SIZE: Final = 1.5  # of a drawn drone, over that of a Crazyflie
FRONT: Final = (245, 245, 245)  # color of the rotors ahead
AXES: Final = 0.075  # m, of an estimate
DASH: Final = 0.06  # m
PALE: Final = 0.18  # opacity of a footprint
FLOOR_GAP: Final = 0.002  # m above the floor, and between footprints, so that none shines through
SIGMAS: Final = 2.0  # of the ellipsoids
MIN_SEMIAXIS: Final = 0.005  # m, of an ellipsoid that can be seen
VELOCITY_SCALE: Final = 0.5  # s: length of an arrow over its velocity
MIN_SPEED: Final = 0.02  # m/s, of an arrow that can be seen
GOAL: Final = 0.07  # m, from the middle of the cross at a goal to its ends
CIRCLE: Final = np.array(
    [(math.cos(angle), math.sin(angle), 0.0) for angle in np.linspace(0.0, math.tau, 33)]
)  # closed, of radius 1
PALETTE: Final = (
    (0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233),
    (90, 90, 90), (160, 140, 0),
)  # fmt: skip
LINE_WIDTHS: Final = {"trails": 3.0, "goals": 2.5, "planned": 1.5}  # px
LAYERS: Final = {
    "trails": "trails",
    "estimates": f"estimates ({SIGMAS:g} std)",
    "goals": "goals",
    "planned": "planned paths",
    "velocities": "commanded velocities",
    "radii": "avoidance radii",
    "footprints": "camera footprints",
}
"""Groups of objects that can be hidden, and their labels."""


def color_of(row: int) -> tuple[int, int, int]:
    """Return the color of the agent in a row."""
    return PALETTE[row % len(PALETTE)]


class SwarmScene:
    """The agents of a flight as objects of a page.

    Args:
        server: Of the page.
        agents: Their names and cameras.
        radius: That the avoider keeps free around each agent, m; None if unknown.
    """

    def __init__(
        self, server: viser.ViserServer, agents: Sequence[Agent], radius: float | None
    ) -> None:
        self._page = page = server.scene
        self._cameras = [agent.camera for agent in agents]
        self._layers = {name: page.add_frame(f"/{name}", show_axes=False) for name in LAYERS}
        self.agents: list[Any] = []
        self.footprints: dict[int, Footprint] = {}  # of agents with a camera, by row
        self.estimates: list[Any] = []
        self.ellipsoids: list[Any] = []
        self.arrows: list[Any] = []
        self._rings: list[Any] = []
        self._lines: dict[str, list[_Lines]] = {name: [] for name in LINE_WIDTHS}
        for row, agent in enumerate(agents):
            color = color_of(row)
            self._add_agent(agent, color)
            if agent.camera is not None:
                self.footprints[row] = Footprint(page, f"/footprints/{agent.name}", row)
            self._add_estimate(agent.name, color)
            if radius is not None:
                ring = segments(radius * CIRCLE)
                self._rings.append(add_lines(page, f"/radii/{agent.name}", ring, color, 1.0))
            for layer, width in LINE_WIDTHS.items():
                hidden = np.zeros((1, 2, 3))
                handle = add_lines(page, f"/{layer}/{agent.name}", hidden, color, width)
                self._lines[layer].append(_Lines(handle))
            self.arrows.append(
                page.add_arrows(
                    f"/velocities/{agent.name}",
                    np.zeros((1, 2, 3)),
                    color,
                    visible=False,
                    shaft_radius=0.008,
                    head_radius=0.022,
                    head_length=0.05,
                )
            )

    def add_controls(self, gui: viser.GuiApi) -> None:
        """Add a switch for each layer."""
        with gui.add_folder("show", expand_by_default=False):
            for name, label in LAYERS.items():
                box = gui.add_checkbox(label, initial_value=True)
                box.on_update(partial(switch, self._layers[name]))

    def show(self, now: Snapshot) -> None:
        """Move everything to where it is in a snapshot."""
        for row, agent in enumerate(self.agents):
            agent.visible = bool(np.isfinite(now.position[row]).all())
            if agent.visible:
                agent.position, agent.wxyz = now.position[row], now.attitude[row, [3, 0, 1, 2]]
            self._show_estimate(row, now)
            for ring in self._rings[row : row + 1]:
                ring.visible, ring.position = agent.visible, now.position[row]
            self._lines["trails"][row].draw(segments(now.trail[:, row]))
            self._lines["goals"][row].draw(_cross(now.goal[row]))
            self._lines["planned"][row].draw(dashes(now.path[row]))
            if (camera := self._cameras[row]) is not None:
                outline = footprint(camera, now.position[row], now.attitude[row])
                self.footprints[row].draw(outline)
        self._show_velocities(now)

    def _show_estimate(self, row: int, now: Snapshot) -> None:
        """Draw what the localizer estimates, beside the ground truth."""
        position, covariance = now.estimate[row], now.covariance[row]
        finite = bool(np.isfinite(position).all() and np.isfinite(covariance).all())
        marker, ellipsoid = self.estimates[row], self.ellipsoids[row]
        marker.visible = finite and now.simulated
        ellipsoid.visible = finite
        if finite:
            variance, axes = np.linalg.eigh(covariance)
            semiaxes = SIGMAS * np.sqrt(np.maximum(variance, 0.0))
            ellipsoid.scale = tuple(np.maximum(semiaxes, MIN_SEMIAXIS).tolist())
            ellipsoid.wxyz = viser.transforms.SO3.from_matrix(
                axes * np.sign(np.linalg.det(axes))
            ).wxyz
            ellipsoid.position = marker.position = position
            half = now.yaw[row] / 2
            marker.wxyz = (math.cos(half), 0.0, 0.0, math.sin(half))

    def _show_velocities(self, now: Snapshot) -> None:
        for arrow, begin, velocity in zip(self.arrows, now.position, now.velocity, strict=True):
            speed = float(np.linalg.norm(velocity))  # NaN if it is unknown
            arrow.visible = speed >= MIN_SPEED and bool(np.isfinite(begin).all())
            if arrow.visible:
                points = np.stack([begin, begin + VELOCITY_SCALE * velocity])[None]
                arrow.points = points.astype(np.float32)

    def _add_agent(self, agent: Agent, color: tuple[int, int, int]) -> None:
        page, name = self._page, f"/agents/{agent.name}"
        self.agents.append(page.add_frame(name, show_axes=False))
        for part, mesh, paint in (("body", frame_and_rear(), color), ("front", front(), FRONT)):
            page.add_mesh_simple(
                f"{name}/{part}", mesh.vertices, mesh.faces, color=paint, flat_shading=True,
                side="double", scale=SIZE, cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
        page.add_label(f"{name}/name", agent.name, position=(0.0, 0.0, 0.1), anchor="bottom-center")
        if agent.camera is not None:
            x, y, z, w = agent.camera.rotation
            page.add_camera_frustum(
                f"{name}/camera",
                fov=2 * math.atan2(agent.camera.height / 2, agent.camera.matrix[1]),
                aspect=agent.camera.width / agent.camera.height,
                scale=0.08,
                thickness=1.5,
                thickness_units="screen",
                color=color,
                wxyz=(w, x, y, z),
                position=agent.camera.position,
            )

    def _add_estimate(self, name: str, color: tuple[int, int, int]) -> None:
        page = self._page
        self.estimates.append(
            page.add_frame(f"/estimates/{name}/axes", axes_length=AXES, axes_radius=0.004)
        )
        self.ellipsoids.append(
            page.add_icosphere(
                f"/estimates/{name}/ellipsoid",
                radius=1.0,
                color=color,
                opacity=0.3,
                cast_shadow=False,
                receive_shadow=False,
            )
        )


class Footprint:
    """What a camera sees of the floor: a pale area, in the color of its agent.

    Args:
        page: To draw on.
        name: Of the area on the page.
        row: Of the agent.
    """

    def __init__(self, page: viser.SceneApi, name: str, row: int) -> None:
        self._height = FLOOR_GAP * (row + 1)
        self._outline = np.zeros((0, 3))
        self.area: Any = page.add_mesh_simple(
            name, np.zeros((3, 3)), np.array([[0, 1, 2]]), color=color_of(row), opacity=PALE,
            side="double", cast_shadow=False, receive_shadow=False, visible=False,
        )  # fmt: skip

    def draw(self, outline: Array) -> None:
        """Fill a closed outline, (K, 3) m, around its middle; none if it is empty."""
        if np.array_equal(outline, self._outline):
            return
        self._outline = outline
        self.area.visible = len(outline) > 0
        if len(outline):
            vertices = np.concatenate([outline[:-1].mean(axis=0, keepdims=True), outline])
            rim = np.arange(1, len(outline))
            vertices[:, 2] += self._height
            self.area.vertices = vertices.astype(np.float32)
            self.area.faces = np.stack([0 * rim, rim, rim + 1], axis=1).astype(np.uint32)


class _Lines:
    """Line segments of one agent, which are sent to the page when they change."""

    def __init__(self, handle: Any) -> None:
        self._handle = handle
        self._segments = np.zeros((0, 2, 3), np.float32)

    def draw(self, segments: NDArray[np.float32]) -> None:
        """Draw segments, (K, 2, 3) m."""
        if not np.array_equal(segments, self._segments):
            self._segments = segments
            self._handle.visible = len(segments) > 0
            if len(segments):
                self._handle.points = segments


def switch(layer: Any, event: Any) -> None:
    """Show or hide a layer, as a checkbox was switched."""
    layer.visible = event.target.value


def segments(points: Array) -> NDArray[np.float32]:
    """Return a line through (K, 3) points as segments (K - 1, 2, 3), without unknown points."""
    points = points[np.isfinite(points).all(axis=1)]
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def dashes(path: Array) -> NDArray[np.float32]:
    """Return a dashed line through the corners of a path, (K, 3) m, as segments (M, 2, 3)."""
    if len(path) < 2:  # noqa: PLR2004 -- a line has two ends
        return np.zeros((0, 2, 3), np.float32)
    lengths = np.concatenate([[0.0], np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum()])
    along = np.arange(0.0, lengths[-1], 2 * DASH)
    ends = np.minimum(along + DASH, lengths[-1])
    points = [
        np.stack([np.interp(where, lengths, path[:, axis]) for axis in range(3)], axis=1)
        for where in (along, ends)
    ]
    return np.stack(points, axis=1).astype(np.float32)


def _cross(goal: Array) -> NDArray[np.float32]:
    """Return a cross at a position as segments (3, 2, 3); none if it is unknown."""
    arms = GOAL * np.eye(3)
    cross = np.stack([goal - arms, goal + arms], axis=1).astype(np.float32)
    return cross[np.isfinite(cross).all(axis=(1, 2))]
