"""What arrives from the drones: samples of their estimators, and the newest report of each."""

from __future__ import annotations

import math

from star_core import Array, Mask, Rows
from star_core.toolkit import compiled

POSITION, YAW, FORCE = 7, 10, 11  # first columns of a sample: z, then x and y


@compiled
def arrive(
    samples: Array,
    heard: Mask,
    newest: Array,
    agent: Rows,
    time: Array,
    velocity: Array,
    rates: tuple[Array, Array, Array, Array],
) -> None:
    """Write the samples that arrive into the columns of a table, and the newest of each drone.

    Args:
        samples: (cycles, N, SAMPLE) as `star_sim.estimator.believe` writes them.
        heard: (cycles, N) those that arrive: K of them.
        newest: (N, SAMPLE) changed: the last sample of each drone.
        agent: (K,) output: rows of the drones.
        time: (K,) output: s.
        velocity: (K, 3) output: m/s.
        rates: (K,) outputs: yaw rate, rad/s, roll and pitch, rad, and height, m.
    """
    yaw_rate, roll, pitch, height = rates
    k = 0
    for cycle in range(samples.shape[0]):
        for row in range(samples.shape[1]):
            if not heard[cycle, row]:
                continue
            sample = samples[cycle, row]
            for column in range(len(sample)):
                newest[row, column] = sample[column]
            agent[k], time[k] = row, sample[0]
            for axis in range(3):
                velocity[k, axis] = sample[1 + axis]
            yaw_rate[k], roll[k], pitch[k], height[k] = sample[4], sample[5], sample[6], sample[7]
            k += 1


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
