"""What the newest samples of the estimators say of the drones."""

from __future__ import annotations

import math

from star_core import Array
from star_core.toolkit import compiled

POSITION, YAW, FORCE = 7, 10, 11  # first columns of a sample: z, then x and y


@compiled
def describe(
    newest: Array,
    now: float,
    position: Array,
    velocity: Array,
    attitude: Array,
    age: Array,
    force: Array,
) -> None:
    """Write what the newest samples say of each drone, in its odometry frame.

    Args:
        newest: (N, SAMPLE) as `star_sim.estimator.believe` writes them.
        now: Time of the last complete cycle, s.
        position: (N, 3) output: m.
        velocity: (N, 3) output: m/s.
        attitude: (N, 4) output: unit quaternions x, y, z, w from the body to the odometry frame.
        age: (N,) output: s.
        force: (N, 2) output: specific force along x and y of the body, m/s².
    """
    for row in range(len(newest)):
        sample = newest[row]
        ahead, aside, yaw = sample[1], sample[2], sample[YAW]
        cos, sin = math.cos(yaw), math.sin(yaw)
        velocity[row, 0] = cos * ahead - sin * aside
        velocity[row, 1] = sin * ahead + cos * aside
        velocity[row, 2] = sample[3]
        position[row, 0], position[row, 1] = sample[POSITION + 1], sample[POSITION + 2]
        position[row, 2] = sample[POSITION]
        cr, sr = math.cos(sample[5] / 2), math.sin(sample[5] / 2)
        cp, sp = math.cos(sample[6] / 2), math.sin(sample[6] / 2)
        cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
        straight, both, pitched, yawed = cp * cy, sp * sy, sp * cy, cp * sy
        attitude[row, 0] = sr * straight - cr * both
        attitude[row, 1] = cr * pitched + sr * yawed
        attitude[row, 2] = cr * yawed - sr * pitched
        attitude[row, 3] = cr * straight + sr * both
        passed = now - sample[0]
        age[row] = max(passed, 0.0)
        force[row, 0], force[row, 1] = sample[FORCE], sample[FORCE + 1]
