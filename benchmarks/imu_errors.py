"""Identify the errors of an IMU from recorded flights: `python benchmarks/imu_errors.py [DIR]`.

Each flight is an ``.npz`` of the set NanoBench (arXiv 2603.09908), with a motion-capture pose
beside gyro and accelerometer at 100 Hz. Printed per flight and over all flights: heading drift of
the integrated gyro, constant and slowly changing errors, and noise above 10 Hz. Motion capture has
errors of its own, so the figures are upper bounds.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Literal

import numpy as np
from recorded_flights import FOLDER, recorded
from scipy.signal import butter, filtfilt
from scipy.spatial.transform import Rotation

RATE = 100.0  # Hz
MIN_HEIGHT = 0.25  # m, in the air
MARGIN = 100  # samples, at both ends of the flight
GRAVITY = 9.81  # m/s²
SPAN = 1000  # samples, over which the heading error's change is measured


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    print(
        f"{'flight':18s} {'yaw drift':>9s} {'10 s':>6s} {'gyro z':>7s} {'bias x, y, z':>14s} slow"
    )
    print(f"{'':18s} {'°/s':>9s} {'°':>6s} {'°/s':>7s} {'mg':>14s} mg")
    rows = []
    for path in recorded(folder):
        errors = identify(np.load(path))
        rows.append(errors)
        print(f"{path.stem:18s}", line(errors))
    table = np.array(rows)
    print(f"{'std':18s}", line(table.std(axis=0)))
    print(f"{'median magnitude':18s}", line(np.median(np.abs(table), axis=0)))


def line(errors: Any) -> str:
    drift, change, noise, *forces = errors
    bias, slow = forces[:3], forces[3:]
    return f"{drift:9.3f} {change:6.2f} {noise:7.2f} {numbers(bias)} {numbers(slow)}"


def numbers(values: Any) -> str:
    return " ".join(f"{value:4.0f}" for value in values)


def identify(flight: Any) -> list[float]:
    """Return yaw drift °/s, its change in 10 s °, gyro noise °/s, bias and slow errors mg."""
    air = np.flatnonzero(flight["position"][:, 2] > MIN_HEIGHT)
    part = slice(air[0] + MARGIN, air[-1] - MARGIN)
    attitude = Rotation.from_quat(flight["attitude"][part])
    yaw, pitch, roll = attitude.as_euler("ZYX").T
    _, q, r = flight["gyro"][part].T
    rate = (q * np.sin(roll) + r * np.cos(roll)) / np.cos(pitch)
    drift = np.degrees(np.cumsum(rate) / RATE - np.unwrap(yaw))
    slope = np.polyfit(np.arange(len(drift)) / RATE, drift, 1)[0]
    change = (drift[SPAN:] - drift[:-SPAN]).std()
    noise = np.degrees(filtered(r[:, None], 10.0, "high").std())
    acceleration = np.gradient(filtered(flight["velocity"][part], 3.0), 1 / RATE, axis=0)
    force = attitude.inv().apply(acceleration + np.array([0.0, 0.0, GRAVITY])) / GRAVITY
    wrong = 1000 * (flight["accelerometer"][part] - force)
    slow = filtered(wrong, 0.2)[MARGIN:-MARGIN].std(axis=0)
    return [slope, change, noise, *wrong.mean(axis=0), *slow]


def filtered(values: Any, frequency: float, kind: Literal["low", "high"] = "low") -> Any:
    """Return (T, K) values passed through a Butterworth filter of second order, forth and back."""
    return filtfilt(*butter(2, frequency / (RATE / 2), kind), values, axis=0)


if __name__ == "__main__":
    main()
