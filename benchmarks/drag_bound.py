"""Bound how soon a flow sensor x 0.7 can be noticed by what is on board: ``drag_bound.py``.

A drone flies straight, or on the circle of the fault matrix, and its flow sensor sees 0.7 times the
motion from a known moment on. The estimator takes that over as `MotionCheck` describes it, while
the controller holds the reported velocity. Printed are the seconds until the position is wrong by
0.3 m, and the deflections until then: by the accelerometer, whose errors are followed by a Kalman
filter with the constants of `DragCheck`, by tilt and velocity, and by both. A deflection is the
mean of the best test statistic over its standard deviation (Neyman and Pearson), so 0.43 over it is
the Cramer-Rao bound of the velocity's missing share. No test that takes one of 100 fault-free
flights of five drones for two minutes for faulty notices more of the faults in time than the column
after that has. The last two are the seconds after which the expected evidence of drag, and of drag
and tilt, is `MIN_EVIDENCE`; half the square of a deflection is the expected evidence.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Final

import numpy as np

from star_core import Array
from star_monitors.drag_check import (
    BIAS_STD,
    BIAS_WANDER,
    DRAG,
    MIN_EVIDENCE,
    NOISE,
    NOISE_OF_SPEED,
    SCALE_STD,
    SCALE_TIME,
)
from star_monitors.motion_check import CORRECTION_RATE, FLOW_NOISE, TILT_RATE

FACTOR: Final = 0.7  # of the flow
MAX_ERROR: Final = 0.3  # m
HEIGHT: Final = 0.6  # m
RADIUS: Final = 1.2  # m, of the circle
SPEEDS: Final = (0.25, 0.4, 0.5, 1.0)  # m/s
PERIOD: Final = 0.01  # s
LEARNT: Final = 60.0  # s in the air before
WATCHED: Final = 100 * 5 * 120.0  # s of flight with one false alarm
WATCHED_AFTER: Final = 30.0  # s after the fault begins


def main() -> None:
    print(
        "| path | m/s | 0.3 m after s | drag | tilt | both | noticed, at most "
        "| evidence by drag after s | by both |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for path, radius in (("straight", math.inf), ("circle", RADIUS)):
        for speed in SPEEDS:
            missing, tilt = taken_over(speed)
            drag = by_drag(speed, speed / radius, missing)
            wrong = int(np.argmax(np.cumsum(missing) * PERIOD > MAX_ERROR))
            seconds, both = PERIOD * wrong, np.hypot(drag, tilt)
            limit = NormalDist().inv_cdf(1 - seconds / WATCHED)
            share = NormalDist().cdf(both[wrong] - limit)
            print(
                f"| {path} | {speed:g} | {seconds:.1f} | {drag[wrong]:.1f} | {tilt[wrong]:.1f} "
                f"| {both[wrong]:.1f} | {100 * share:.0f} % "
                f"| {detection_time(drag)} | {detection_time(both)} |"
            )


def detection_time(deflection: Array) -> str:
    """Return the seconds after which the expected evidence is `MIN_EVIDENCE`, if ever."""
    enough = deflection**2 / 2 > MIN_EVIDENCE
    return f"{PERIOD * np.argmax(enough):.1f}" if enough.any() else f"> {WATCHED_AFTER:g}"


def taken_over(speed: float) -> tuple[Array, Array]:
    """Return true less reported speeds, (T,) m/s, and the deflections by the tilt until then, (T,).

    The correction is that of `MotionCheck` less the drag, which the accelerometer measures.
    """
    missing = acceleration = energy = 0.0
    rows = []
    for _ in range(round(WATCHED_AFTER / PERIOD)):
        correction = CORRECTION_RATE * (FACTOR * (speed + missing) - speed)
        energy += PERIOD * correction**2 / (FLOW_NOISE * HEIGHT**2)
        change = -correction - acceleration
        acceleration += PERIOD * TILT_RATE * correction
        missing += PERIOD * change
        rows.append((missing, math.sqrt(energy)))
    missing_speeds, deflections = np.array(rows).T
    return missing_speeds, deflections


def by_drag(speed: float, turn: float, missing: Array) -> Array:
    """Return the deflections by the accelerometer until each moment, (T,).

    Args:
        speed: Reported, m/s.
        turn: Rate of the velocity's direction in the body, rad/s.
        missing: (T,) true less reported speeds, m/s.
    """
    covariance = np.diag([BIAS_STD**2, BIAS_STD**2, SCALE_STD**2])
    wander = np.diag([BIAS_WANDER, BIAS_WANDER, 2 * SCALE_STD**2 / SCALE_TIME]) * PERIOD
    keep = np.diag([1.0, 1.0, 1 - PERIOD / SCALE_TIME])
    variance = NOISE * (1 + NOISE_OF_SPEED * speed**2) / PERIOD
    errors, squares = np.zeros(3), []
    signals = np.concatenate([np.zeros(round(LEARNT / PERIOD)), -DRAG * missing])
    for k, signal in enumerate(signals):
        angle = turn * k * PERIOD
        direction = np.array([math.cos(angle), math.sin(angle)])
        observed = np.column_stack([np.eye(2), -DRAG * speed * direction])
        errors, covariance = keep @ errors, keep @ covariance @ keep + wander
        total = observed @ covariance @ observed.T + variance * np.eye(2)
        gain = np.linalg.solve(total, observed @ covariance).T
        innovation = signal * direction - observed @ errors
        squares.append(innovation @ np.linalg.solve(total, innovation))
        errors = errors + gain @ innovation
        covariance -= gain @ observed @ covariance
    return np.asarray(np.sqrt(np.cumsum(squares[-len(missing) :])))


if __name__ == "__main__":
    main()
