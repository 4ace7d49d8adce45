"""Compare drag with velocity in recorded flights: `python benchmarks/drag.py [DIR]`.

Each flight is an ``.npz`` of the set NanoBench, as `recorded_flights` documents. Printed per flight
are the deceleration by the air per speed along both axes of the body (least squares over 1 Hz),
how far means over 1 s are from `star_monitors.drag_check.DRAG` times the true velocity, and what
`DragCheck` makes of the reported velocity: its greatest evidence, and how long it takes to find the
flow sensor if the velocity is multiplied by 0.7 from the middle of the flight on.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from imu_errors import GRAVITY, MARGIN, MIN_HEIGHT, filtered
from recorded_flights import FOLDER, read, recorded
from scipy.spatial.transform import Rotation

from star_monitors.drag_check import DRAG, DragCheck

STEPS = 5  # samples between two reports
WINDOW = 100  # samples over which drag is averaged


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    print("| flight | m/s | drag x, y 1/s | error m/s² | evidence | x 0.7 found after s |")
    print("|---|---|---|---|---|---|")
    for path in recorded(folder):
        flight = read(path)
        drag, error = measured(flight.data)
        evidence, _ = checked(flight.data, math.inf)
        middle = float(flight.data["time"][len(flight.data["time"]) // 2])
        _, detection_time = checked(flight.data, middle)
        print(
            f"| {path.stem} | {flight.speed:.2f} | {drag[0]:.2f} {drag[1]:.2f} | {error:.3f} "
            f"| {evidence:.1f} | {detection_time - middle:.1f} |"
        )


def measured(data: Any) -> tuple[Any, float]:
    """Return the drag along x and y, 1/s, and the standard deviation of means over 1 s, m/s²."""
    air = np.flatnonzero(data["position"][:, 2] > MIN_HEIGHT)
    part = slice(air[0] + MARGIN, air[-1] - MARGIN)
    velocity = Rotation.from_quat(data["attitude"][part]).inv().apply(data["velocity"][part])[:, :2]
    force = GRAVITY * data["accelerometer"][part][:, :2]
    slow, fast = filtered(force, 1.0), filtered(velocity, 1.0)
    slow, fast = slow - slow.mean(axis=0), fast - fast.mean(axis=0)
    rest = force + DRAG * velocity
    summed = np.cumsum(rest - rest.mean(axis=0), axis=0)
    means = (summed[WINDOW:] - summed[:-WINDOW]) / WINDOW
    return -(slow * fast).sum(axis=0) / (fast**2).sum(axis=0), float(means.std())


def checked(data: Any, wrong_from: float) -> tuple[float, float]:
    """Return the greatest evidence, and when the flow sensor was found, s.

    Args:
        data: Arrays of the flight.
        wrong_from: Time from which the reported velocity is multiplied by 0.7, s.
    """
    check, most = DragCheck(1), 0.0
    for k in range(0, len(data["time"]), STEPS):
        time = float(data["time"][k])
        reported = data["estimate_velocity"][k] * (0.7 if time >= wrong_from else 1.0)
        telemetry: Any = SimpleNamespace(
            time=time,
            age=np.zeros(1),
            velocity=reported[None],
            attitude=data["attitude"][k : k + 1],
            specific_force=GRAVITY * data["accelerometer"][k : k + 1, :2],
        )
        up = data["position"][k : k + 1, 2] > MIN_HEIGHT
        if check.check(telemetry, up)[0]:
            return most, time
        most = max(most, float(check.evidence[0]))
    return most, math.inf


if __name__ == "__main__":
    main()
