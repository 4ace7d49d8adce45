"""Agents that hover in the way of others, for avoiders that may not lead around them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations
from typing import Final

import numpy as np

from star_core import Array, Mask, Mission, Problem, Registry
from star_core.toolkit import Rehearsal
from star_explain.separation import kept_distance

PERIOD: Final = 0.5  # s
MIN_SPEED: Final = 0.1  # m/s of an agent on its way
PARKED_SPEED: Final = 0.05  # m/s, below which an agent hovers
DISTANCE_TOLERANCE: Final = 0.05  # m, beyond the distance that agents of a rehearsal keep
STALL_TIME: Final = 10.0  # s for which an agent creeps that makes no way
STALL_SPEED: Final = 0.005  # m/s, above which it creeps; one that arrives soon is slower


def parked_problems(
    mission: Mission, registry: Registry, rehearsal: Rehearsal
) -> Iterator[Problem]:
    """Warn if an agent has to fly around one that hovers, and its avoider may stop before it.

    The avoiders concerned are those that do not declare `AvoiderSpec.uncertain_positions`: that
    traffic flows in narrow places too. An agent meets one that hovers if it passes it at the
    distance that the two keep, or if it creeps for long near it. Of 20 random missions with
    `voronoi` and `potential` and exact positions, 6 have such an agent; in two of these it never
    arrived, in no other mission.
    Of one that declares `AvoiderSpec.leads_around`, only agents whose goals others can enclose are
    reported.
    """
    scene, avoider = mission.scene, mission.plugins["avoider"]
    offer = registry.find("avoider", avoider.use).offer
    if "radius" not in avoider.options or offer.uncertain_positions:
        return
    time, position, _, airborne = rehearsal.sampled(PERIOD)
    if len(time) < 2:  # noqa: PLR2004 -- no motion
        return
    speed = np.linalg.norm(np.gradient(position, PERIOD, axis=0)[..., :2], axis=2)
    hovers = airborne & (speed < PARKED_SPEED)
    stuck = np.ones(airborne.shape, np.bool_)
    if offer.leads_around:
        stuck = _to_crowded_goals(position, hovers, 2 * kept_distance(mission))
    for row, other in permutations(range(len(scene.agents)), 2):
        offset = position[:, row] - position[:, other]
        meets = airborne[:, row] & hovers[:, other] & stuck[:, row]
        meets &= np.abs(offset[:, 2]) < scene.limits.vertical_separation
        apart = np.hypot(offset[:, 0], offset[:, 1])
        kept = kept_distance(mission)
        meets &= ((speed[:, row] > MIN_SPEED) & (apart < kept + DISTANCE_TOLERANCE)) | (
            _stalls(speed[:, row]) & (apart < 2 * kept)
        )
        if meets.any():
            yield Problem(
                ("avoider",),
                f"{scene.agents[other].name} hovers in the way of {scene.agents[row].name} after "
                f"about {time[meets.argmax()]:.0f} s of the rehearsal, and with {avoider.use!r} "
                "an agent may wait forever before another: use another avoider, or waypoints",
                "agent-in-the-way",
                warning=True,
            )
            return


def _stalls(speed: Array) -> Mask:
    """Return when an agent creeps, and has for `STALL_TIME`: (T,), by (T,) speeds, m/s."""
    creeps = (speed > STALL_SPEED) & (speed < MIN_SPEED)
    samples = round(STALL_TIME / PERIOD)
    return np.convolve(creeps, np.ones(samples), "full")[: len(speed)] >= samples


def _to_crowded_goals(position: Array, hovers: Mask, gap: float) -> Mask:
    """Return when agents are on their way to hover next to two others that hover then: (T, N).

    Args:
        position: (T, N, 3) m.
        hovers: (T, N).
        gap: Distance of two agents that others pass between, m.
    """
    crowded = np.zeros(hovers.shape, np.bool_)
    for row in range(hovers.shape[1]):
        stops = hovers[:, row].nonzero()[0]
        offset = position[stops, :, :2] - position[stops, row, None, :2]
        near = hovers[stops] & (np.hypot(offset[..., 0], offset[..., 1]) < gap)
        among = np.append(near.sum(axis=1) > 2, False)  # noqa: PLR2004 -- itself is one
        crowded[:, row] = among[np.searchsorted(stops, np.arange(len(hovers)))]
    return crowded
