"""The inner loop: every step of every drone between two ticks, in one call."""

from __future__ import annotations

import math

import numpy as np

from star_core.toolkit import compiled, subroutine
from star_sim.aerodynamics import push, wash
from star_sim.airframe import STEP, STEPS_PER_CYCLE
from star_sim.batch import BATCH_SIZE, LANES
from star_sim.battery import drain
from star_sim.body import fly
from star_sim.cascade import regulate
from star_sim.commander import follow
from star_sim.contact import keep_out, separate, surface_below
from star_sim.discharge import CASCADE_RESISTANCE, RESISTANCE
from star_sim.drone import Record
from star_sim.estimator import believe, lean
from star_sim.position import aim
from star_sim.supervisor import bits, supervise

BLOCK = 128  # cycles of random numbers, and of samples, that are kept at once


@compiled
def advance(  # noqa: C901, PLR0913, PLR0917 -- see star_sim.drone for why there are no more
    drones: Record,
    cascades: Record,
    leads: Record,
    order: Record,
    keys: Record,
    normals: Record,
    texture: Record,
    boxes: Record,
    spans: Record,
    edges: Record,
    samples: Record,
    imu: Record,
    air: Record,
    near: Record,
    step: int,
    steps: int,
    noisy: bool,  # noqa: FBT001 -- a kernel's arguments have no names
) -> None:
    """Advance all drones by `steps` steps of 2 ms from step number `step`.

    At the start of a cycle of five steps each drone's commander, supervisor and position loop run,
    at its end contacts, battery and estimator. A call may stop and start within a cycle, but must
    not go beyond a multiple of `BLOCK` cycles.

    The arguments are not grouped: with a tuple for the obstacles and one for the sweep, sums are
    compiled in another order, and four of the flights of ``benchmarks/flight_bits.py`` differ.

    Args:
        drones: (N,) records of `DRONE`, changed in place.
        cascades: (N,) records of `CASCADE`, changed in place; None for the ideal controller.
        leads: (N, 3) for `regulate`; None where no drone has the controller of Mellinger.
        order: (N,) rows sorted along a line, for `separate`.
        keys: (N,) room for `separate`.
        normals: (BLOCK, N, 4) standard normal numbers.
        texture: (M, M) scale error of the flow sensor over the floor.
        boxes: (P, 6) from `prisms`, as `spans` and `edges` are; None where there are no obstacles,
            for which nothing is compiled then.
        spans: (P, 2).
        edges: (E, 4).
        samples: (BLOCK, N, SAMPLE) what the estimators stream: row ``(cycle - 1) % BLOCK`` is
            written at the end of each cycle.
        imu: (BLOCK, N, WANDERING) errors of the IMU and the flow sensor; None without, for which
            nothing is compiled then.
        air: (BLOCK, N, 3) velocities of the air in the map, m/s; None for still air without effect
            on the drones, for which nothing is compiled then.
        near: (N, `star_sim.aerodynamics.COLUMNS`) buffer for the downwash; None without downwash
            and ground effect, for which nothing is compiled then.
        step: Steps since the start.
        steps: To take.
        noisy: Whether the estimators err.
    """
    batch = np.empty(BATCH_SIZE)
    end = step + steps
    while step < end:
        phase = step % STEPS_PER_CYCLE
        ahead = min(STEPS_PER_CYCLE - phase, end - step)
        if phase == 0:
            now = step * STEP
            for i in range(len(drones)):
                cascade = None if cascades is None else cascades[i]
                _control(drones[i], cascade, None if leads is None else leads[i], now, imu)
        for first in range(0, len(drones), LANES):
            fly(drones, cascades, first, ahead, batch)
        step += ahead
        if step % STEPS_PER_CYCLE == 0:
            if len(drones) > 1:
                separate(drones, order, keys)
                if near is not None:
                    wash(drones, order, keys, near)
            cycle = step // STEPS_PER_CYCLE
            row = (cycle - 1) % BLOCK
            for i in range(len(drones)):
                drone = drones[i]
                if air is not None:
                    washed = None if near is None else near[i]
                    push(drone, air[row, i], washed, None if cascades is None else cascades[i])
                if boxes is not None:
                    keep_out(drone, boxes, spans, edges)
                    if imu is not None:
                        surface_below(drone, boxes, spans, edges)
                drain(drone, RESISTANCE if cascades is None else CASCADE_RESISTANCE)
                errors = None if imu is None else imu[row, i]
                believe(drone, cycle, normals[row, i], texture, noisy, errors, samples[row, i])


@subroutine
def _control(drone: Record, cascade: Record, lead: Record, now: float, imu: Record) -> None:
    """Run the control loops of one drone at the start of a cycle."""
    follow(drone, now)
    supervise(drone, now)
    if cascade is not None:
        regulate(drone, cascade, lead)
        return
    aim(drone)
    if imu is not None:
        lean(drone)


@compiled
def report(drones: Record, now: float, attitude: Record, state: Record) -> None:
    """Write each drone's estimated attitude and the bits of its state.

    Args:
        drones: (N,) records.
        now: Mission time, s.
        attitude: (N, 4) unit quaternions x, y, z, w from the body to the odometry frame: turns by
            roll about x, then by pitch about y, then by yaw about z.
        state: (N,) bits of `Supervisor`.
    """
    for i in range(len(drones)):
        drone = drones[i]
        cr, sr = math.cos(drone.believed_roll / 2), math.sin(drone.believed_roll / 2)
        cp, sp = math.cos(drone.believed_pitch / 2), math.sin(drone.believed_pitch / 2)
        cy, sy = math.cos(drone.believed_yaw / 2), math.sin(drone.believed_yaw / 2)
        attitude[i, 0] = sr * cp * cy - cr * sp * sy
        attitude[i, 1] = cr * sp * cy + sr * cp * sy
        attitude[i, 2] = cr * cp * sy - sr * sp * cy
        attitude[i, 3] = cr * cp * cy + sr * sp * sy
        state[i] = bits(drone, now)
