"""Finds tags without a picture: their corners as a lens shows them, for missions without vision."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from star_core import Array, Camera, Mask, Rows, Tag, World
from star_sim.camera_sim.motion import POSE, camera_at, mounting
from star_sim.camera_sim.obstacle_rasterizer import blocked
from star_sim.camera_sim.optics import Optics, optics
from star_sim.camera_sim.projection import project
from star_sim.camera_sim.shot import Shot
from star_sim.camera_sim.tag_rasterizer import HUNG
from star_sim.camera_sim.tag_tables import MODULES, corners, frames
from star_sim.compiled import Record, compiled, kernel
from star_sim.contact import prisms

BORDER = 3.0  # px, OpenCV's detector takes no corner that is nearer to the edge of the image
# px of a module, across the tag's longest side: of rendered tags on the floor with smaller ones
# OpenCV's detector finds fewer than half.
LEAST_MODULE = 1.65
ACROSS = 3  # points along each side of a tag, of which none may be hidden


class Spotter:
    """A camera whose own processor finds tags, so that no picture is needed.

    A tag is found if its face is turned to the camera, it lies wholly in the image, no obstacle
    hides a part of it, and it is not so far or so slanted that its modules are too small. Nearer
    tags hide nothing, and nothing is missed or mistaken by chance.

    Args:
        camera: As it really is.
        tags: As they really are.
        world: For its obstacles.
        noise: Deviation of each corner in u and in v, px.
        smallest: Width of modules, across a tag's longest side, that are still made out, px.
    """

    def __init__(
        self,
        camera: Camera,
        tags: Sequence[Tag],
        world: World,
        *,
        noise: float = 0.2,
        smallest: float = LEAST_MODULE,
    ) -> None:
        self._optics, self._mount, self._prisms = optics(camera), mounting(camera), prisms(world)
        self._ids = np.array([tag.id for tag in tags], np.int64)
        self._places = frames(tags)
        self._corners = corners(self._places)
        self._noise, self._smallest = noise, smallest

    def spot(self, shot: Shot, rng: np.random.Generator | None = None) -> tuple[Rows, Array]:
        """Return the tags that are found.

        Args:
            shot: Where the body is.
            rng: Eight numbers are drawn from it for each tag found; without it corners are exact.

        Returns:
            (K,) numbers of tags, in the order of the tags given; (K, 4, 2) px: bottom left, bottom
            right, top right and top left of the tag as one reads it.
        """
        packed = shot.packed()
        flat = project(self._corners.reshape(-1, 3), packed, self._mount, self._optics)
        pixels = flat.reshape(-1, 4, 2)
        found = visible(
            pixels,
            self._places,
            self._corners,
            packed,
            self._mount,
            self._optics,
            *self._prisms,
            self._smallest,
        )
        pixels = pixels[found]
        if rng is not None:
            pixels += rng.normal(0.0, self._noise, pixels.shape)
        return self._ids[found], pixels


@kernel
def visible(  # noqa: PLR0913, PLR0917 -- a kernel takes all it needs
    pixels: Record,
    places: Record,
    corners: Record,
    shot: Record,
    mount: Record,
    lens: Optics,
    boxes: Record,
    spans: Record,
    edges: Record,
    smallest: float,
) -> Mask:
    """Return which tags are found, (M,).

    Args:
        pixels: (M, 4, 2) corners in the image, NaN where there are none.
        places: (M, 13) of `frames`.
        corners: (M, 4, 3) in the map, m.
        shot: (13,) of `Shot.packed`.
        mount: (12,) of `mounting`.
        lens: Of `optics`.
        boxes: (P, 6) of `star_sim.contact.prisms`, as `spans` and `edges` are.
        spans: (P, 2).
        edges: (E, 4).
        smallest: Width of modules that are still made out, px.
    """
    pose = np.empty(POSE)
    camera_at(shot, mount, 0.0, pose)
    eye = (pose[9], pose[10], pose[11])
    found = np.zeros(len(pixels), np.bool_)
    for tag in range(len(pixels)):
        place = places[tag]
        ahead = 0.0
        for axis in range(3):
            ahead += (eye[axis] - place[axis]) * place[9 + axis]
        if ahead <= 0.0:
            continue  # its back
        within = True
        for k in range(4):
            u, v = pixels[tag, k, 0], pixels[tag, k, 1]
            within &= BORDER <= u <= lens.width - 1 - BORDER  # not so for NaN
            within &= BORDER <= v <= lens.height - 1 - BORDER
        if not within or _module(pixels[tag]) < smallest:
            continue
        hidden = False
        for k in range(ACROSS * ACROSS):
            right, up = (k % ACROSS) / (ACROSS - 1), (k // ACROSS) / (ACROSS - 1)
            x, y, z = _between(corners[tag], right, up)
            hidden |= blocked(eye, (x, y, z), HUNG, boxes, spans, edges)
        found[tag] = not hidden
    return found


@compiled
def _module(pixels: Record) -> float:
    """Return how wide a tag's modules are across its longest side, px."""
    longest = 0.0
    for k in range(4):
        one, two = pixels[k], pixels[(k + 1) % 4]
        longest = max(longest, math.hypot(two[0] - one[0], two[1] - one[1]))
    ax, ay = pixels[2, 0] - pixels[0, 0], pixels[2, 1] - pixels[0, 1]  # the diagonals
    bx, by = pixels[3, 0] - pixels[1, 0], pixels[3, 1] - pixels[1, 1]
    return float(0.5 * abs(ax * by - ay * bx) / (longest * MODULES))


@compiled
def _between(corners: Record, right: float, up: float) -> tuple[float, float, float]:
    """Return a point of a tag's square, given as shares of its sides, in the map, m."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(4):
        share = right if k in (1, 2) else 1.0 - right
        share *= up if k >= 2 else 1.0 - up  # noqa: PLR2004 -- the upper two
        x += share * corners[k, 0]
        y += share * corners[k, 1]
        z += share * corners[k, 2]
    return x, y, z
