"""Draws random worlds: a fence, obstacles of all shapes, landmarks, targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from tests.fuzz.ground_truth import clearance
from tests.fuzz.harness import Draw

Data: TypeAlias = dict[str, Any]

APART: Final = 0.65  # m between the positions of two agents
DRIFT_APART: Final = (0.65, 1.8, 2.5)  # m, if they drift
OBSTACLE_GAP: Final = 0.3  # m, of a goal: more than the planner's clearance
FENCE_GAP: Final = 0.15  # m
MAX_HEIGHT: Final = 1.75  # m
TAGS: Final = 96  # numbers of tags for landmarks; those of targets follow


class Room:
    """A random world.

    Args:
        draw: Source of all that is random.
        agents: For so many agents.
        localizer: Of the mission; `apriltag` needs landmarks, and with `flow` agents drift.

    Attributes:
        apart: Distance between the positions of agents, m.
    """

    def __init__(self, draw: Draw, agents: int, *, localizer: str) -> None:
        self._draw = draw
        self.apart = draw.choice(DRIFT_APART) if localizer == "flow" else APART
        wide = 0.9 * math.sqrt(agents) * self.apart + 0.3
        self.half = [round(draw.uniform(1.2, 2.2) + wide, 2) for _ in range(2)]
        self.top = round(draw.uniform(2.0, 2.5), 2)
        self.obstacles: Data = {}
        for i in range(draw.choice([0, 0, 1, 2, 3, 4, 5, 6])):
            self.obstacles[f"obstacle{i}"] = self._obstacle()
        self.landmarks = self._landmarks(draw.uniform(1.0, 1.5)) if localizer == "apriltag" else {}
        self.targets: Data = {}

    def world(self) -> Data:
        """Return the world as its file has it."""
        x, y = self.half
        return {
            "star": 1,
            "name": "random",
            "fence": {"low": [-x, -y, 0.0], "high": [x, y, self.top]},
            "obstacles": self.obstacles,
            "landmarks": self.landmarks,
            "targets": self.targets,
        }

    def free(self, point: Sequence[float], gap: float = OBSTACLE_GAP) -> bool:
        """Return whether an agent can hover at a point, m."""
        inside = all(
            abs(value) <= half - FENCE_GAP for value, half in zip(point, self.half, strict=False)
        )
        height = 0.0 <= point[2] <= min(MAX_HEIGHT, self.top - FENCE_GAP)
        return inside and height and self.clear(point, gap)

    def clear(self, point: Sequence[float], gap: float) -> bool:
        """Return whether a point is farther from all obstacles than a gap, m."""
        at = np.array(point, np.float64)
        return all(clearance(form, at) > gap for form in self.obstacles.values())

    def add_targets(self, low: Sequence[float], high: Sequence[float]) -> list[str]:
        """Add targets on the floor of an area; return their names."""
        for _ in range(self._draw.randint(0, 2)):
            x, y = (self._draw.uniform(a + 0.2, b - 0.2) for a, b in zip(low, high, strict=True))
            others = [*self.landmarks.values(), *self.targets.values()]
            if self.clear((x, y, 0.0), 0.2) and all(
                math.dist((x, y), other["at"][:2]) > 0.3 for other in others
            ):
                name, tag = f"target{len(self.targets)}", TAGS + len(self.targets)
                self.targets[name] = {"tags": [tag], "at": [round(x, 2), round(y, 2), 0.0]}
        return list(self.targets)

    def _obstacle(self) -> Data:
        draw = self._draw
        x, y = (round(draw.uniform(-half, half), 2) for half in self.half)
        a, b = (round(draw.uniform(0.1, 0.9), 2) for _ in range(2))
        foot, top = draw.choice([
            (0.0, self.top), (0.0, round(draw.uniform(0.3, 1.3), 2)),
            (round(draw.uniform(0.9, 1.4), 2), self.top),
        ])  # fmt: skip
        turn = draw.uniform(0, math.tau)
        cos, sin = math.cos(turn), math.sin(turn)
        form: Data = draw.choice([
            {"cylinder": {"centre": [x, y], "radius": round(a / 2 + 0.02, 2)}},
            {"box": {"centre": [x, y], "size": [a, b], "yaw_deg": round(math.degrees(turn), 1)}},
            {"polyline": [[x, y], [round(x + 2 * a * cos, 2), round(y + 2 * a * sin, 2)],
                          [round(x + 2 * a * cos - b * sin, 2),
                           round(y + 2 * a * sin + b * cos, 2)]][: draw.choice([2, 3])],
             "thickness": 0.1},
            {"polygon": [[round(x + u * cos - v * sin, 2), round(y + u * sin + v * cos, 2)]
                         for u, v in ((0, 0), (a, 0), (a / 2, b / 3), (0, b))]},
        ])  # fmt: skip
        return {**form, "height": [foot, top]}

    def _landmarks(self, spacing: float) -> Data:
        """A grid of tags on the floor."""
        axes = [
            np.linspace(-half + 0.4, half - 0.4, max(2, round((2 * half - 0.8) / spacing) + 1))
            for half in self.half
        ]
        at = [(round(float(x), 2), round(float(y), 2), 0.0) for x in axes[0] for y in axes[1]]
        return {
            f"tag{i}": {"tags": [i], "at": list(point)}
            for i, point in enumerate(at[:TAGS])
            if self.clear(point, 0.1)
        }
