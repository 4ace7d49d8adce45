"""Agents that come nearer to others, obstacles or the fence than the drift of positions permits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Mask, Mission, Problem, Registry
from star_core.toolkit import ALONE_SHARE, CONTACT_RADIUS, MAX_MARGIN_RATIO, Rehearsal
from star_explain.passing import PASSING_SHARE
from star_explain.separation import kept_clearance, kept_distance

PERIOD: Final = 0.5  # s
MIN_SPEED: Final = 0.1  # m/s, relative: two agents that are slower do not pass each other
EVASION_TIME: Final = 5.0  # s that passing others takes: those lanes take 8 s in place of 3
NEAR_USE: Final = 2 / 3  # of their room, from which on two agents count as near each other
MAX_RISK: Final = 0.01  # probability of less than the separation from which on there is a warning
MAX_WALL_RISK: Final = 0.003
"""The same of contacts with obstacles, and of flights out of the fence, in a whole mission. With
0.01, the probabilities of 84 random missions without a warning added up to 0.024."""
FENCE_TOLERANCE: Final = 0.2  # m, by which an agent may leave the fence: it is no wall


def drift_problems(mission: Mission, registry: Registry, rehearsal: Rehearsal) -> Iterator[Problem]:
    """Warn of collisions, and of flights out of the fence, that the drift of positions permits.

    The risk of a pair, or of an agent and an obstacle, is that of its worst moment, and that of the
    mission at most the sum over these.
    """
    scene, localizer = mission.scene, mission.plugins["localizer"]
    offer = registry.find("localizer", localizer.use).offer
    time, position, yaw, airborne = rehearsal.sampled(PERIOD)
    if not airborne.any():
        return
    std = offer.drift(scene, time, position, yaw, **localizer.options)
    flight = RehearsedFlight(time, position, airborne, std)
    if mission.scene.limits.separation > 0:
        near = [*pair_problems(mission, flight)]
        yield from near or room_problems(mission, flight)
    yield from obstacle_problems(mission, registry, flight)
    yield from fence_problems(mission, flight)


class RehearsedFlight(NamedTuple):
    """A rehearsal with the expected errors of the positions.

    Attributes:
        time: (T,) s.
        position: (T, N, 3) planned positions, m.
        airborne: (T, N) whether agents fly.
        std: (T, N) standard deviations of the horizontal errors, m.
    """

    time: Array
    position: Array
    airborne: Mask
    std: Array


def pair_problems(mission: Mission, flight: RehearsedFlight) -> Iterator[Problem]:
    """Warn if agents probably come closer than the separation because their positions drift.

    By their estimated positions, two agents whose goals are near to each other keep the separation,
    or twice the radius of the avoider if that is more; while they pass each other, it is enlarged
    by the margins for their uncertain positions. Their real distance is smaller than the separation
    if the error along the line between them, which is normal with the variances of both, exceeds
    the rest.
    """
    limits, scene = mission.scene.limits, mission.scene
    localizer = mission.plugins["localizer"]
    time, std = flight.time, flight.std
    base = kept_distance(mission)
    total, worst, where = 0.0, 0.0, ""
    for first, second in combinations(range(len(scene.agents)), 2):
        planned, passing, level = _encounter(flight, first, second, limits.vertical_separation)
        margin = limits.uncertainty_margin * (std[:, first] + std[:, second])
        kept = base + np.where(passing, np.minimum(margin, MAX_MARGIN_RATIO * base), 0.0)
        rest = (np.maximum(planned, kept) - limits.separation) / np.hypot(
            std[:, first], std[:, second]
        )
        rest = np.where(level, rest, np.inf)
        at = int(rest.argmin())
        risk = math.erfc(rest[at] / math.sqrt(2)) / 2
        total += risk
        if risk > worst:
            worst = risk
            where = (
                f"{scene.named((first, second))} are {planned[at]:.1f} m apart after about "
                f"{time[at]:.0f} s of the rehearsal, when positions by {localizer.use!r} have a "
                f"standard deviation of {std[at, [first, second]].max():.2f} m"
            )
    if total > MAX_RISK:
        yield Problem(
            ("localizer",),
            f"{where}; agents come closer than limits.separation ({limits.separation:g} m) with a "
            f"probability of up to {100 * min(1.0, total):.0f} %: keep them farther apart, "
            "shorten the mission, or locate them by landmarks",
            "drift-exceeds-separation",
            warning=True,
        )


def room_problems(mission: Mission, flight: RehearsedFlight) -> Iterator[Problem]:
    """Warn if two agents have so little room between them that the core lands one of them.

    They need `Limits.uncertainty_margin` standard deviations of their distance, and `ALONE_SHARE`
    of that if no others are near them. Where they pass each other, they keep `PASSING_SHARE` of the
    margins at least, leave their paths for that, and lose `EVASION_TIME`: both brings them nearer
    to others that evade too, at greater deviations.
    """
    limits, scene = mission.scene.limits, mission.scene
    localizer = mission.plugins["localizer"]
    time, std = flight.time, flight.std
    base, n = kept_distance(mission), len(scene.agents)
    evades = _evasions(mission, flight)
    later = np.minimum(np.arange(len(time)) + round(EVASION_TIME / PERIOD), len(time) - 1)
    std = np.where(evades > 0.0, std[later], std)
    uses = np.zeros((len(time), n, n))
    for first, second in combinations(range(n), 2):
        planned, passing, level = _encounter(flight, first, second, limits.separation)
        deviations = limits.uncertainty_margin * std[:, [first, second]]
        margin = np.minimum(deviations.sum(axis=1), MAX_MARGIN_RATIO * base)
        kept = base + np.where(passing, PASSING_SHARE * margin, 0.0)
        aside = np.where(passing, evades[:, first] + evades[:, second], 0.0)
        room = np.maximum(planned - aside, kept) - 2 * CONTACT_RADIUS
        use = np.hypot(deviations[:, 0], deviations[:, 1]) / np.maximum(room, CONTACT_RADIUS)
        uses[:, first, second] = uses[:, second, first] = np.where(level, use, 0.0)
    neighbors = (uses > NEAR_USE).sum(axis=2)
    alone = (neighbors[:, :, None] <= 1) & (neighbors[:, None, :] <= 1)
    uses = np.where(alone, ALONE_SHARE * uses, uses)
    k, row, other = (int(i) for i in np.unravel_index(int(uses.argmax()), uses.shape))
    if uses[k, row, other] > 1.0:
        yield Problem(
            ("localizer",),
            f"{scene.named((row, other))} have no room between them after about "
            f"{time[k]:.0f} s of the rehearsal, when positions by {localizer.use!r} have a "
            f"standard deviation of {std[k, [row, other]].max():.2f} m: one of them lands; keep "
            "them farther apart, shorten the mission, or locate them better",
            "no-room-for-drift",
            warning=True,
        )


def _evasions(mission: Mission, flight: RehearsedFlight) -> Array:
    """Return how far agents leave their paths to pass others: (T, N) m.

    Each of two agents makes way for half of what their paths lack to the distance that they keep.
    """
    limits, base = mission.scene.limits, kept_distance(mission)
    evades = np.zeros(flight.std.shape)
    for first, second in combinations(range(flight.std.shape[1]), 2):
        planned, passing, level = _encounter(flight, first, second, limits.separation)
        margin = limits.uncertainty_margin * (flight.std[:, first] + flight.std[:, second])
        kept = base + PASSING_SHARE * np.minimum(margin, MAX_MARGIN_RATIO * base)
        aside = np.where(passing & level, np.maximum(kept - planned, 0.0) / 2, 0.0)
        for row in (first, second):
            evades[:, row] = np.maximum(evades[:, row], aside)
    return evades


def _encounter(
    flight: RehearsedFlight, first: int, second: int, vertical: float
) -> tuple[Array, Mask, Mask]:
    """Return the planned distance of two agents in the plane, (T,) m, and when they pass, and meet.

    They pass at a relative speed of `MIN_SPEED`, and meet in the air, at nearly the same height.
    """
    offset = flight.position[:, first] - flight.position[:, second]
    passing = np.linalg.norm(np.gradient(offset, PERIOD, axis=0), axis=1) > MIN_SPEED
    level = flight.airborne[:, first] & flight.airborne[:, second]
    level &= np.abs(offset[:, 2]) < vertical
    return np.hypot(offset[:, 0], offset[:, 1]), passing, level


def obstacle_problems(
    mission: Mission, registry: Registry, flight: RehearsedFlight
) -> Iterator[Problem]:
    """Warn if agents probably touch obstacles because their positions drift.

    By its estimated position an agent keeps the clearance of planner or avoider, or what the dry
    run keeps if that is more; in motion, the clearance is enlarged by the margin for its uncertain
    position. It touches the obstacle if the error towards it exceeds the rest.
    """
    scene, (_, position, airborne, std) = mission.scene, flight
    base = kept_clearance(mission, registry)
    margin = np.minimum(scene.limits.uncertainty_margin * std, MAX_MARGIN_RATIO * base)
    moving = np.linalg.norm(np.gradient(position, PERIOD, axis=0), axis=2) > MIN_SPEED
    kept = base + np.where(moving, margin, 0.0)
    total, worst, where = 0.0, 0.0, ""
    for obstacle in scene.world.obstacles:
        planned = obstacle.distances(position.reshape(-1, 3)).reshape(std.shape)
        rest = (np.maximum(planned, kept) - CONTACT_RADIUS) / std
        risk, greatest, text = _risk(mission, flight, np.where(airborne, rest, np.inf), planned)
        total += risk
        if greatest > worst:
            worst, where = greatest, text.format(f"obstacle {obstacle.name!r}")
    yield from _wall_problem(total, where, "agents touch obstacles")


def fence_problems(mission: Mission, flight: RehearsedFlight) -> Iterator[Problem]:
    """Warn if agents probably leave the fence by more than `FENCE_TOLERANCE` by their drift."""
    fence = mission.scene.world.fence
    low, high = np.array(fence.low[:2]), np.array(fence.high[:2])
    horizontal = flight.position[..., :2]
    room = np.minimum(horizontal - low, high - horizontal).min(axis=2)
    rest = np.where(flight.airborne, (room + FENCE_TOLERANCE) / flight.std, np.inf)
    total, _, where = _risk(mission, flight, rest, room)
    leave = f"agents leave the fence by more than {FENCE_TOLERANCE:g} m"
    yield from _wall_problem(total, where.format("the fence"), leave)


def _risk(
    mission: Mission, flight: RehearsedFlight, rest: Array, distance: Array
) -> tuple[float, float, str]:
    """Return the sum of the agents' risks, the greatest one, and where that is.

    Args:
        mission: The mission.
        flight: Its rehearsal.
        rest: (T, N) errors that agents can afford, in standard deviations.
        distance: (T, N) planned ones, for the text, m.
    """
    at = rest.argmin(axis=0)  # the worst moment of each agent
    risks = [math.erfc(value / math.sqrt(2)) / 2 for value in rest.min(axis=0).tolist()]
    row = int(np.argmax(risks))
    k = int(at[row])
    name, use = mission.scene.agents[row].name, mission.plugins["localizer"].use
    where = (
        f"{name} is {distance[k, row]:.1f} m from {{}} after about {flight.time[k]:.0f} s of the "
        f"rehearsal, when its position by {use!r} has a standard deviation of "
        f"{flight.std[k, row]:.2f} m"
    )
    return math.fsum(risks), risks[row], where


def _wall_problem(total: float, where: str, what: str) -> Iterator[Problem]:
    if total > MAX_WALL_RISK:
        yield Problem(
            ("localizer",),
            f"{where}; {what} with a probability of up to {100 * min(1.0, total):.2g} %: keep "
            "farther away, shorten the mission, or locate agents by more landmarks",
            "drift-exceeds-clearance",
            warning=True,
        )
