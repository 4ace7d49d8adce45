"""The agents' cameras: exposure and arrival of their images."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import Any

import numpy as np

from star_core import Camera, Detections, Frames, Rows, Scene
from star_sim.airframe import NEVER, STEP
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.disturbances import Disturbances, lamps_and_clutter
from star_sim.camera_sim.floor_texture import floor
from star_sim.camera_sim.geometric import OnboardDetector
from star_sim.camera_sim.ground_truth import real_camera, real_tags
from star_sim.camera_sim.options import CameraOptions
from star_sim.camera_sim.renderer import Renderer
from star_sim.drone import Drones

_STREAM, _SURVEY_STREAM, _MOUNTING_STREAM = 7341, 7342, 7343


class Cameras:
    """All cameras of the swarm.

    Each camera takes images at its own rate from mission time 0 on, staggered by agent.

    Args:
        scene: Agents with their cameras, tags, obstacles, seed.
        options: Error model.
        needs_images: Whether the images of the agent in a row are needed; others are not rendered.
    """

    def __init__(
        self,
        scene: Scene,
        options: CameraOptions,
        needs_images: Callable[[int], bool] = lambda _row: True,
    ) -> None:
        self._options, self._needs_images = options, needs_images
        surveyed = [
            tag
            for tag in (*scene.world.landmarks, *scene.world.targets)
            if tag.of not in options.covered
        ]
        self._tags = np.array([tag.id for tag in surveyed], np.int64)
        self._numbers = np.array(sorted(tag.id for tag in surveyed) or [0])
        tags = real_tags(surveyed, [scene.seed, _SURVEY_STREAM], options)
        others = lamps_and_clutter(scene.world.fence, scene.seed, options.lamps, options.clutter)
        self._disturbances: dict[int, Disturbances] = {}
        self._latency: dict[int, float] = {}  # s, mean of each camera
        self._cameras: dict[int, Camera] = {}
        self._streams: dict[int, np.random.Generator] = {}
        self._models: dict[int, Renderer | OnboardDetector] = {}
        ground = floor(scene.seed) if options.mode == "rendered" else None
        for row, agent in enumerate(scene.agents):
            if agent.camera is None:
                continue
            rng = np.random.default_rng([scene.seed, _MOUNTING_STREAM, row])
            self._cameras[row] = camera = real_camera(agent.camera, rng, options)
            offset = options.latency_offset_std * float(rng.standard_normal())
            self._latency[row] = options.latency + offset
            self._streams[row] = np.random.default_rng([scene.seed, _STREAM, row])
            self._models[row] = (
                OnboardDetector(camera, tags, scene.world, noise=options.corner_noise_std)
                if ground is None
                else Renderer(
                    camera, tags, scene.world, ground, others, noise=options.pixel_noise_std
                )
            )
            self._disturbances[row] = Disturbances(camera, [scene.seed, row], options)
        self._periods = {  # of each camera, from mission time 0 to its next image
            row: (i + 1) / len(self._cameras) for i, row in enumerate(self._cameras)
        }
        self._queue = [(self._due(row), row) for row in self._cameras]
        heapq.heapify(self._queue)
        self._under_way: list[tuple[float, int, float, Any]] = []  # arrival, row, taken, content

    @property
    def next_step(self) -> int:
        """The simulator's step at which the next image is due."""
        return self._queue[0][0] if self._queue else NEVER

    def compile(self, drones: Drones) -> None:
        """Render and discard an image, so that compilation does not delay the first one."""
        for row in list(self._models)[:1]:  # the compiled code serves all cameras
            self._see(_shot(drones, row), row, np.random.default_rng(0))

    def take(self, drones: Drones, step: int) -> None:
        """Take the images that are due at `step`, at the drones' true poses."""
        while self._queue and self._queue[0][0] <= step:
            _, row = heapq.heappop(self._queue)
            stream = self._streams[row]
            self._periods[row] += 1.0
            heapq.heappush(self._queue, (max(step + 1, self._due(row)), row))
            if not self._needs_images(row):
                continue
            latency = self._latency[row] + self._options.latency_std * stream.standard_normal()
            lost = stream.random() < self._options.drop_rate
            disturbances = self._disturbances[row]
            content = self._see(disturbances.shaken(_shot(drones, row)), row, stream)
            if self._options.mode == "rendered":
                content = disturbances.disturbed(content)
            if not lost:
                taken = step * STEP
                self._under_way.append((taken + max(0.0, latency), row, taken, content))

    def arrived(self, now: float) -> tuple[Frames, Detections]:
        """Return the images or detections that arrived since the last call, up to `now`, s."""
        arrivals = sorted(
            (item for item in self._under_way if item[0] <= now), key=lambda item: item[:2]
        )
        self._under_way = [item for item in self._under_way if item[0] > now]
        if not arrivals:
            return Frames.none(), Detections.none()
        arrival, agent, taken = (
            np.array(column) for column in list(zip(*arrivals, strict=True))[:3]
        )
        if not self._options.timestamps:
            taken = np.full(len(arrivals), np.nan)
        contents = [content for *_, content in arrivals]
        if self._options.mode == "rendered":
            return Frames(agent, taken, arrival, tuple(contents)), Detections.none()
        counts = [len(ids) for ids, _ in contents]
        return Frames.none(), Detections(
            agent=np.repeat(agent, counts),
            tag=np.concatenate([ids for ids, _ in contents]),
            corners=np.concatenate([corners for _, corners in contents]),
            taken=np.repeat(taken, counts),
            arrived=np.repeat(arrival, counts),
        )

    def _see(self, shot: Shot, row: int, stream: np.random.Generator) -> Any:
        """Return an agent's image, or the visible tags and their corners."""
        model = self._models[row]
        if isinstance(model, Renderer):
            return model.render(shot, stream, self._misprinted(stream))
        tags, corners = model.detect(shot, stream)
        return self._misidentified(tags, stream), corners

    def _due(self, row: int) -> int:
        """Return the step nearest to an agent's next image, so that rates hold on average."""
        return round(self._periods[row] / self._cameras[row].rate / STEP)

    def _misprinted(self, stream: np.random.Generator) -> Rows | None:
        """Return the rows of the tags whose patterns the tags of an image show, or None."""
        if not self._options.wrong_id_rate:
            return None
        shown = self._misidentified(self._tags, stream)
        rows = np.argsort(self._tags)
        misprinted: Rows = rows[np.searchsorted(self._tags, shown, sorter=rows)]
        return misprinted

    def _misidentified(self, tags: Rows, stream: np.random.Generator) -> Rows:
        """Replace the ids of some tags by those of others."""
        n = len(self._numbers)
        wrong = stream.random(len(tags)) < self._options.wrong_id_rate
        further = stream.integers(1, max(n, 2), len(tags))
        others = self._numbers[(np.searchsorted(self._numbers, tags) + further) % n]
        return np.where(wrong, others, tags)


def _shot(drones: Drones, row: int) -> Shot:
    drone = drones[row]
    return Shot(drone["position"], drone["attitude"], drone["velocity"], drone["rates"])
