"""What the disturbances of the simulated camera do to the tags that are found.

Each option of ``transport: {use: sim, camera: {...}}`` is switched on by itself; images are those
of a camera that hovers at random poses among tags of 0.168 m on the floor, 0.6 to 2 m away. Found
tags are compared with the corners that ``mode: geometric`` computes for the same poses without
vibration.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from printed import command_line, show

from star_apriltag.vision.detector import Detector
from star_core import Camera, Fence, Tag, World
from star_core.testing import scene
from star_core.toolkit import CameraModel
from star_sim.camera_sim.cameras import Cameras
from star_sim.camera_sim.options import camera_options
from star_sim.drone import standing

FLAT = (0.0, 0.0, 0.0, 1.0)
TAGS = tuple(
    Tag(9 * i + j, 0.168, (0.6 * i - 2.4, 0.6 * j - 2.4, 0.0), FLAT, f"{i} {j}")
    for i in range(9)
    for j in range(9)
)
EXACT = {"survey_std": 0.0, "survey_yaw_std_deg": 0.0, "mounting_std_deg": 0.0}
EXACT |= {"mounting_position_std": 0.0, "latency": 0.0, "latency_std": 0.0}
CASES: dict[str, dict[str, Any]] = {
    "none": {},
    "exposure_step_0.6": {"exposure_step": 0.6},
    "fixed_pattern_std_6": {"fixed_pattern_std": 6.0},
    "jpeg_quality_40": {"jpeg_quality": 40},
    "vibration_std_deg_0.3": {"vibration_std_deg": 0.3},
    "lamps_200": {"lamps": 200},
    "clutter_200": {"clutter": 200},
}


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    arguments = command_line(__doc__, images=60).parse_args()
    cv2.setNumThreads(1)
    figures: dict[str, float] = {}
    for name, options in CASES.items():
        figures |= {
            f"{name}_{figure}": value
            for figure, value in detection(options, arguments.images).items()
        }
    show(figures, as_json=arguments.json)


def detection(options: dict[str, Any], count: int) -> dict[str, float]:
    """Return the share of tags found, false tags, and the corners' RMS error, px."""
    world = World("floor", Fence((-3.0, -3.0, 0.0), (3.0, 3.0, 3.0)), landmarks=TAGS)
    (agent,) = (room := scene(1)).agents
    where = replace(room, agents=(replace(agent, camera=Camera()),), world=world)
    exact = {"corner_noise_std": 0.0, "mode": "geometric"}
    images = Cameras(where, camera_options(**EXACT, **options))
    truth = Cameras(where, camera_options(**EXACT, **exact))
    detector, rng = Detector(CameraModel(Camera())), np.random.default_rng(0)
    present = matches = false = 0
    errors: list[float] = []
    for _ in range(count):
        x, y, yaw = rng.uniform((-1, -1, -math.pi), (1, 1, math.pi))
        drones = standing(np.array([[x, y, rng.uniform(0.6, 1.0)]]), np.array([yaw]), 1.0)
        step = images.next_step
        images.take(drones, step)
        truth.take(drones, step)
        (image,) = images.arrived(math.inf)[0].image
        expected = truth.arrived(math.inf)[1]
        corners = dict(zip(expected.tag.tolist(), expected.corners, strict=True))
        detections = detector.detect(image)
        present += len(corners)
        for tag, pixels in zip(detections.tag.tolist(), detections.corners, strict=True):
            false += tag >= len(TAGS)
            if tag in corners:
                matches += 1
                errors.append(float(np.square(pixels - corners[tag]).sum(axis=1).mean()))
    rms = math.sqrt(float(np.mean(errors)))
    return {"share_found": matches / present, "false": float(false), "corner_rms_px": rms}


if __name__ == "__main__":
    main()
