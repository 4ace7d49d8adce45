"""Draws tags from tables of their cells: in their regions of the image, supersampled at edges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from star_core import Array, Tag
from star_core.toolkit import compiled, rotation_from_quaternion, square_corners, subroutine
from star_sim.camera_sim.camera_pose import Canvas, Exposure
from star_sim.camera_sim.projection import plane_homography, touch
from star_sim.drone import Record

SAMPLES = 2  # per pixel along each side, at edges
MAX_EMBEDDING = 0.02  # m, depth inside an obstacle at which a tag is visible: it is on its face


@compiled
def draw_tags(canvas: Canvas, exposure: Exposure, tags: TagTables) -> None:
    """Draw all tags that face the camera, the nearest first.

    Args:
        canvas: Light is increased, gap is reduced.
        exposure: The image.
        tags: The true ones.
    """
    frames, poses = tags.frames, exposure.poses
    height, width = canvas.light.shape
    regions = np.empty((len(frames), 4), np.int64)
    distance = np.empty(len(frames))
    order = np.empty(len(frames), np.int64)
    count = 0
    camera = poses[height // 2, poses.shape[1] // 2]
    for tag in range(len(frames)):
        frame = frames[tag]
        x, y, z = camera[9] - frame[0], camera[10] - frame[1], camera[11] - frame[2]
        if x * frame[9] + y * frame[10] + z * frame[11] <= 0.0:
            continue  # its back
        region = regions[tag]
        region[0], region[1], region[2], region[3] = width, height, 0, 0
        touch(tags.rims[tag], exposure, region)
        if region[0] >= region[2] or region[1] >= region[3]:
            continue
        distance[tag] = x * x + y * y + z * z
        hole = count
        while hole > 0 and distance[order[hole - 1]] > distance[tag]:
            order[hole] = order[hole - 1]
            hole -= 1
        order[hole] = tag
        count += 1
    for k in range(count):
        tag = order[k]
        _draw(canvas, exposure, frames[tag], tags.prints[tag], regions[tag])


@subroutine
def _draw(canvas: Canvas, exposure: Exposure, frame: Record, cells: Record, region: Record) -> None:
    """Draw one tag within a region.

    s and t count cells from the left and the top of the rim. A pixel that stays within one cell
    during the whole exposure gets its shade; others are sampled in space and time.
    """
    light, gap, depth = canvas.light, canvas.gap, canvas.depth
    rays, poses = exposure.rays, exposure.poses
    height, width, slices = rays.shape[1], rays.shape[2], poses.shape[1]
    maps = np.empty((slices, 9))
    path = np.empty((2, slices))  # s and t of the center of one pixel
    module, middle = frame[12] / MODULES, slices // 2
    map_ = maps[middle]
    for v in range(region[1], region[3]):
        away = 0.0
        for k in range(slices):
            distance = plane_homography(poses[v, k], frame, module, CELLS / 2, maps[k])
            away = distance if k == middle else away
        above, below = max(v - 1, 0), min(v + 1, height - 1)
        for u in range(region[0], region[2]):
            if gap[v, u] <= 0.0:
                continue
            x, y = rays[0, v, u], rays[1, v, u]
            w = 1.0
            left, top, right, bottom = math.inf, math.inf, -math.inf, -math.inf
            for k in range(slices):
                unit = 1.0 / (maps[k, 6] * x + maps[k, 7] * y + maps[k, 8])
                s = (maps[k, 0] * x + maps[k, 1] * y + maps[k, 2]) * unit
                t = (maps[k, 3] * x + maps[k, 4] * y + maps[k, 5]) * unit
                path[0, k], path[1, k] = s, t
                left, right = min(left, s), max(right, s)
                top, bottom = min(top, t), max(bottom, t)
                w = unit if k == middle else w
            if w >= 0.0 or away * w > depth[v, u] + MAX_EMBEDDING:
                continue
            # cells per pixel to the right and down
            s, t = path[0, middle], path[1, middle]
            s_x, s_y = map_[0] - s * map_[6], map_[1] - s * map_[7]
            t_x, t_y = map_[3] - t * map_[6], map_[4] - t * map_[7]
            before, after = max(u - 1, 0), min(u + 1, width - 1)
            x, y = rays[0, v, after] - rays[0, v, before], rays[1, v, after] - rays[1, v, before]
            step = w / (after - before)
            s_right, t_right = step * (s_x * x + s_y * y), step * (t_x * x + t_y * y)
            x, y = rays[0, below, u] - rays[0, above, u], rays[1, below, u] - rays[1, above, u]
            step = w / (below - above)
            s_down, t_down = step * (s_x * x + s_y * y), step * (t_x * x + t_y * y)

            aside, over = 0.5 * (abs(s_right) + abs(s_down)), 0.5 * (abs(t_right) + abs(t_down))
            left, top, right, bottom = left - aside, top - over, right + aside, bottom + over
            if right <= 0.0 or bottom <= 0.0 or left >= CELLS or top >= CELLS:
                continue
            column, row = math.floor(left), math.floor(top)
            if left >= 0.0 and top >= 0.0 and right < column + 1 and bottom < row + 1:
                light[v, u] += gap[v, u] * cells[row, column]
                gap[v, u] = 0.0
                continue
            covered, shade = _sample(path, s_right, s_down, t_right, t_down, cells)
            if covered > 0.0:
                share = min(covered, gap[v, u])
                light[v, u] += share * shade / covered
                gap[v, u] -= share


@subroutine
def _sample(
    path: Record, s_right: float, s_down: float, t_right: float, t_down: float, cells: Record
) -> tuple[float, float]:
    """Return the share of a pixel that a tag covers, and its light, averaged over the exposure.

    A step from one cell to the next is a ramp as wide as a sample is on the paper, which has the
    variance of the sample's own square: edges are in the right position, whatever their slope.

    Args:
        path: (2, S) s and t of the pixel's center in each slice of the exposure.
        s_right: Cells along s per pixel to the right; the others likewise.
        s_down: Down.
        t_right: Along t.
        t_down: Along t.
        cells: (CELLS, CELLS) gray values.
    """
    narrow = max(1.0, SAMPLES / math.hypot(s_right, s_down))
    low = max(1.0, SAMPLES / math.hypot(t_right, t_down))
    covered = shade = 0.0
    for sample in range(SAMPLES * SAMPLES):
        right = (sample % SAMPLES + 0.5) / SAMPLES - 0.5
        down = (sample // SAMPLES + 0.5) / SAMPLES - 0.5
        s_shift, t_shift = right * s_right + down * s_down, right * t_right + down * t_down
        for k in range(path.shape[1]):
            s, t = path[0, k] + s_shift, path[1, k] + t_shift
            within = 1.0
            if min(s, t) < 1.0 or max(s, t) > CELLS - 1:
                within = _ramp(s * narrow) * _ramp((CELLS - s) * narrow)
                within *= _ramp(t * low) * _ramp((CELLS - t) * low)
                if within <= 0.0:
                    continue
            column, row = int(s + 0.5), int(t + 0.5)  # the nearest edges of cells
            after, below = _ramp((s - column) * narrow), _ramp((t - row) * low)
            west, east = np.uint64(max(column - 1, 0)), np.uint64(min(column, CELLS - 1))
            north, south = np.uint64(max(row - 1, 0)), np.uint64(min(row, CELLS - 1))
            upper = cells[north, west] + after * (cells[north, east] - cells[north, west])
            lower = cells[south, west] + after * (cells[south, east] - cells[south, west])
            covered += within
            shade += within * (upper + below * (lower - upper))
    samples = SAMPLES * SAMPLES * path.shape[1]
    return covered / samples, shade / samples


@subroutine
def _ramp(x: float) -> float:
    """Return a ramp from 0 to 1 for `x` from -1/2 to 1/2."""
    return min(max(x + 0.5, 0.0), 1.0)


MODULES = 8  # per row of a tag of family 36h11, with its black border
RIM = 1  # modules, width of the white border
CELLS = MODULES + 2 * RIM
PAPER, INK = 215.0, 30.0  # gray values
FRAME = 13


class TagTables(NamedTuple):
    """Tags for the renderer."""

    frames: Array  # (M, 13) of `tag_frames`
    rims: Array  # (M, 4, 3) corners of their white borders in the map, m
    prints: Array  # (M, CELLS, CELLS) patterns with white borders, gray values, top row first


def tag_frames(tags: Sequence[Tag]) -> Array:
    """Return (M, 13): center, x, y and z axes of tags in the map, and their edges, m."""
    table = np.empty((len(tags), FRAME))
    for row, tag in zip(table, tags, strict=True):
        row[:3] = tag.position
        row[3:12] = rotation_from_quaternion(tag.rotation).T.ravel()
        row[12] = tag.size
    return table


def corners(frames: Array, scale: float = 1.0) -> Array:
    """Return the corners of tags in the map, in the order of `star_core.toolkit.square_corners`.

    Args:
        frames: (M, 13) of `tag_frames`.
        scale: Size of the square, as a multiple of the black square's.

    Returns:
        (M, 4, 3) m.
    """
    x, y = square_corners(scale)[:, :2, None].swapaxes(0, 1)  # (4, 1) each, of a unit tag
    axes = frames[:, 12, None, None] * (x * frames[:, None, 3:6] + y * frames[:, None, 6:9])
    return np.asarray(frames[:, None, :3] + axes)


def prints(tags: Sequence[Tag]) -> Array:
    """Return the patterns of tags with their white borders, (M, CELLS, CELLS) gray values."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    table = np.full((len(tags), CELLS, CELLS), PAPER)
    for cells, tag in zip(table, tags, strict=True):
        bits = cv2.aruco.generateImageMarker(family, tag.id, MODULES)
        cells[RIM:-RIM, RIM:-RIM] = np.where(bits > 0, PAPER, INK)
    return table
