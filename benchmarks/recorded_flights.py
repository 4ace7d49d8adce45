"""Recorded flights of real Crazyflies: what the files contain, and what of a flight counts.

A file contains arrays over T samples: ``time`` (T,) s; ``position``, ``velocity`` (T, 3) m, m/s and
``attitude`` (T, 4) xyzw of motion capture, z up; ``gyro`` (T, 3) rad/s and ``accelerometer`` (T, 3)
g, in the body; ``pwm`` (T, 4) of 65535; ``setpoint`` (T, 4) x, y, z, m, and yaw, degrees, held
between updates and 0 before the first; ``estimate_position`` and ``estimate_velocity`` (T, 3) on
board; ``voltage`` (T, 1) V.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from star_core import Array

ROOT = Path(__file__).resolve().parents[1]
FOLDER = Path(os.environ.get("STAR_REAL_FLIGHTS", ROOT.parent / "shared" / "real" / "flights"))

AIRBORNE = 0.3  # m: lower than that a drone takes off or lands
SETTLING_TIME = 1.0  # s in the air until a flight counts
LEFT = 1.3  # m from its setpoint: more than any lag of these flights
LEVELLED = 0.5  # cosine of a tilt that no controller asks for
ESTIMATE_LATENCY = 0.017  # s, of the on-board estimate behind motion capture: `identify.py`
SAG = -0.05  # m, mean error of the height: the PID integrates it away, Mellinger's law does not


@dataclass(frozen=True)
class Flight:
    """A recorded flight.

    Attributes:
        name: Of the file.
        data: Its arrays.
        began: Sample at which the motors start.
        counted: Samples that are compared: in the air, until the trajectory is left or ends.
        floor: Height of the marker while the drone stands, m.
    """

    name: str
    data: dict[str, Array]
    began: int
    counted: slice
    floor: float

    @property
    def controller(self) -> str:
        """Which of the firmware's controllers flew, by the height it held."""
        z = self.data["position"][self.counted, 2] - self.data["setpoint"][self.counted, 2]
        return "mellinger" if z.mean() < SAG else "pid"

    @property
    def speed(self) -> float:
        """Median speed of the setpoint, m/s."""
        place, time = self.data["setpoint"][self.counted, :2], self.data["time"][self.counted]
        steps = 20  # samples: setpoints repeat and jump
        way = np.linalg.norm(place[steps:] - place[:-steps], axis=1)
        return float(np.median(way / (time[steps:] - time[:-steps])))


def recorded(folder: Path) -> list[Path]:
    """Return the files of all flights in a folder.

    Raises:
        SystemExit: There are none.
    """
    files = sorted(folder.glob("*.npz"))
    if not files:
        sys.exit(f"no flights (*.npz) in {folder}: name a folder, or set STAR_REAL_FLIGHTS")
    return files


def read(path: Path) -> Flight:
    """Read a flight and find what of it counts.

    Raises:
        SystemExit: An array is missing, or it never flies.
    """
    with np.load(path) as file:
        data = {name: np.asarray(file[name], float) for name in file.files}
    try:
        position, setpoint, pwm = data["position"], data["setpoint"], data["pwm"]
        x, y = data["attitude"][:, 0], data["attitude"][:, 1]
        data["voltage"] = data["voltage"].reshape(-1)
    except KeyError as error:
        sys.exit(f"{path}: no array {error}")
    commanded = np.any(setpoint != 0, axis=1)
    flying = commanded & (pwm.max(axis=1) > 0) & (position[:, 2] > AIRBORNE)
    flying &= setpoint[:, 2] > AIRBORNE
    if not flying.any():
        sys.exit(f"{path}: the drone does not fly")
    began = int(np.flatnonzero(commanded)[0])
    first = int(np.flatnonzero(flying)[0])
    distance = np.linalg.norm(position - setpoint[:, :3], axis=1)
    lost = (distance > LEFT) | (1 - 2 * (x**2 + y**2) < LEVELLED) | ~flying
    lost[-1] = True
    last = first + int(np.argmax(lost[first:]))
    first = int(np.searchsorted(data["time"], data["time"][first] + SETTLING_TIME))
    return Flight(path.stem, data, began, slice(first, last), float(position[:began, 2].mean()))


def body_axes(attitude: Array) -> Array:
    """Return the (S, 3, 3) matrices from body to map."""
    axes: Array = Rotation.from_quat(attitude).as_matrix()
    return axes


def rms(errors: Array) -> float:
    """Return the root of the mean squared norm of (T, K) errors."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))
