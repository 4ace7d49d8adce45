"""Ground truth from motion capture: bodies of a source that localizer ``mocap`` may use too."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from star_core import Array, PluginError, Problem, Registry, Scene, Truth
from star_radio.options import MOCAP_KIND

log = logging.getLogger(__name__)

VELOCITY_INTERVAL: Final = 0.05  # s, over which velocity is a difference of positions
MAX_FRAME_AGE: Final = 0.1  # s: older frames are not used as ground truth


def problems(scene: Scene, options: Mapping[str, Any]) -> Iterator[Problem]:
    """Yield why the system of the option ``mocap`` cannot be used."""
    registry, source = _sources()
    for problem in source.check(registry, scene, options):
        yield Problem(("mocap", *problem.path), problem.message, problem.code)


def _sources() -> tuple[Registry, Any]:
    """Return the plugins, and the class of those that are sources."""
    registry = Registry()
    if MOCAP_KIND not in registry.kinds:
        raise PluginError("mocap: no plugin offers motion-capture sources", "unknown-plugin")
    return registry, registry.kinds[MOCAP_KIND]


class TrueBodies:
    """The bodies of the agents, by a motion-capture system.

    Raises:
        PluginError: It does not answer, or its package is not installed.
    """

    def __init__(self, scene: Scene, options: Mapping[str, Any]) -> None:
        registry, source = _sources()
        self._system = source.connect(registry, scene, options)
        self._stale = False

    def truth(self, began: float) -> Truth | None:
        """Return the newest frame; None before the first. Bodies that are not visible are NaN.

        All bodies are NaN if the newest frame is older than `MAX_FRAME_AGE`; a warning is logged
        once.

        Args:
            began: Mission time 0, s of the computer's clock.
        """
        frames = self._system.recent()
        if not frames:
            return None
        poses = frames[-1].poses
        newest = _time(frames[-1])
        silent = time.monotonic() - frames[-1].arrived
        if silent > MAX_FRAME_AGE:
            poses = np.full_like(poses, np.nan)
            if not self._stale:
                log.warning("radio: mocap sends no frames: no ground truth until it does")
        self._stale = silent > MAX_FRAME_AGE
        velocity = np.full((len(poses), 3), np.nan)
        before = [frame for frame in frames if _time(frame) <= newest - VELOCITY_INTERVAL]
        earlier = (before or frames[:1])[-1 if before else 0]
        if newest > _time(earlier):
            velocity = (poses[:, :3] - earlier.poses[:, :3]) / (newest - _time(earlier))
        return Truth(newest - began, poses[:, :3], velocity, poses[:, 3:])

    def markers(self) -> Array:
        """Return the markers in the newest frame that belong to no body, (M, 3) m."""
        markers: Array = self._system.recent()[-1].markers
        return markers

    def close(self) -> None:
        """Disconnect. Safe to call twice."""
        self._system.close()


def _time(frame: Any) -> float:
    """Return when a frame was taken, or arrived if that is unknown, s."""
    return float(frame.taken if np.isfinite(frame.taken) else frame.arrived)
